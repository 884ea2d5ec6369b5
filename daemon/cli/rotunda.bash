# Tab completion of `rotunda` for bash. Words come from its own help, ids and cameras from the daemon when it serves.

_rotunda_ids() {  # LIST [OPTION...]: ids that the daemon has, the newest 500
  timeout 2 rotunda "$@" --limit 500 --json 2>/dev/null |
    sed -n 's/^ *"id": "\{0,1\}\([^",]*\)"\{0,1\},\{0,1\}$/\1/p'
}

_rotunda_cameras() {  # [OPTION...]: names of the daemon's cameras
  timeout 2 rotunda cameras "$@" --json 2>/dev/null | sed -n 's/^ *"camera": "\([^"]*\)",\{0,1\}$/\1/p' | sort -u
}

_rotunda_commands() {  # of a help text
  sed -n '/^Subcommands:/,$s/^  \([a-z][a-z-]*\) .*/\1/p' <<<"$1"
}

_rotunda_type() {  # HELP OPTION: what the option takes, as the help says it; nothing for a flag
  local name type more
  while read -r name type more; do
    [ "${name#-?,}" = "$2" ] && [[ $type =~ ^[A-Z]+([:=.]|$) ]] || continue
    [[ $more != ...* ]] || type+=...
    echo "$type"
  done <<<"$1"
}

_rotunda() {
  local word=${COMP_WORDS[COMP_CWORD]} line=() command=() socket=() each help words='' type='' since=0 option=''
  COMPREPLY=()
  # `--option=value` comes in three words.
  for each in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do [ "$each" = = ] || line+=("$each"); done
  [ "$word" != = ] || word=''
  help=$(rotunda --help 2>/dev/null)
  for each in "${line[@]}"; do
    if [ -z "$option" ] && grep -qx -- "$each" <<<"$(_rotunda_commands "$help")"; then
      command+=("$each")
      help=$(rotunda "${command[@]}" --help 2>/dev/null)
    elif [[ $each == --* ]]; then
      option=$each since=0
    else
      since=$((since + 1))
      [ "$option" != --socket ] || [ "$since" != 1 ] || socket=(--socket "${each/#\~/$HOME}")
    fi
  done
  [ -z "$option" ] || type=$(_rotunda_type "$help" "$option")
  [ "$since" = 0 ] || [[ $type == *...* ]] || type=''  # the option has its value
  case $type in
    *:{*}*) words=${type#*:\{} words=${words%%\}*} words=${words//,/ } ;;
    CAPTURE*) words=$(_rotunda_ids captures "${socket[@]}") ;;
    CALIBRATION*) words=$(_rotunda_ids calibrations "${socket[@]}") ;;
    ?*) return ;;  # a file, or what nobody can guess
    *) [ "$since" != 0 ] || words=$(_rotunda_commands "$help") ;;
  esac
  if [[ $word == -* ]]; then
    words=$(sed -n 's/^ *\(-[a-z],\)\{0,1\}\(--[a-z-]*\).*/\2/p' <<<"$help")
  elif [ -z "$type" ]; then
    case ${command[0]} in
      captures | calibrations | jobs) words=$(_rotunda_ids "${command[0]}" "${socket[@]}") ;;
      drift) words=$(_rotunda_cameras "${socket[@]}") ;;
    esac
  fi
  mapfile -t COMPREPLY < <(compgen -W "$words" -- "$word")
}

complete -o default -F _rotunda rotunda
