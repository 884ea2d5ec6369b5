# Tab completion of `rotundad` for bash: its options from its own help; what they take are files.

_rotundad() {
  local word=${COMP_WORDS[COMP_CWORD]}
  COMPREPLY=()
  [[ $word == -* ]] || return
  mapfile -t COMPREPLY < <(compgen -W "$(rotundad --help | sed -n 's/^ *\(-[a-z],\)\{0,1\}\(--[a-z-]*\).*/\2/p')" -- "$word")
}

complete -o default -F _rotundad rotundad
