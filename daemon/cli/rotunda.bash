# Tab completion of `rotunda` for bash. Words come from its own help, ids from the daemon when it serves.

_rotunda_ids() {  # LIST FIELD: ids that the daemon has
  rotunda "$1" --json 2>/dev/null | sed -n 's/^ *"'"$2"'": "\{0,1\}\([^",]*\)"\{0,1\},\{0,1\}$/\1/p'
}

_rotunda() {
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} command=${COMP_WORDS[1]} words
  COMPREPLY=()
  if [ "$COMP_CWORD" = 1 ]; then
    words=$(rotunda --help | sed -n '/^Subcommands:/,$s/^  \([a-z][a-z-]*\) .*/\1/p')
  elif [[ $word == -* ]]; then
    words=$(rotunda "$command" --help 2>/dev/null | grep -o -- '^ *-[-a-z,]*' | grep -o -- '--[a-z-]*')
  elif [[ $before == --from ]]; then
    words=$(_rotunda_ids captures id)
  elif [[ $before == --* ]]; then
    words=$(rotunda "$command" --help 2>/dev/null | sed -n "s/^ *$before TEXT:{\([^}]*\)}.*/\1/p" | tr , ' ')
  else
    case $command in
      captures | calibrations | jobs) words=$(_rotunda_ids "$command" id) ;;
      *) return ;;  # a file
    esac
  fi
  mapfile -t COMPREPLY < <(compgen -W "$words" -- "$word")
}

complete -o default -F _rotunda rotunda
