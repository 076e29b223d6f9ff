# Completion of hrsi for bash. For now:  source <(hrsi completion bash)
# For good:  hrsi completion bash > ~/.local/share/bash-completion/completions/hrsi
_hrsi_options() {{
  case $1 in
{options}
  esac
}}
_hrsi_values() {{
  case "$1 $2" in
{values}
  esac
}}
_hrsi() {{
  local cur=${{COMP_WORDS[COMP_CWORD]}} prev=${{COMP_WORDS[COMP_CWORD-1]}} command=${{COMP_WORDS[1]}}
  local offer=FILES word words=
  COMPREPLY=()
  if [ "$cur" = "=" ]; then cur=
  elif [ "$prev" = "=" ]; then prev=${{COMP_WORDS[COMP_CWORD-2]}}; fi
  if [ "$COMP_CWORD" -eq 1 ]; then offer="{commands} --help --version"
  elif [ "$command" = help ]; then offer="{algorithms}"
  elif [ "$command" = completion ]; then offer="{shells}"
  else
    case $prev in --*) offer=$(_hrsi_values "$command" "$prev"); offer=${{offer:-FILES}} ;; esac
    case $offer,$cur in FILES,-*) offer=$(_hrsi_options "$command") ;; esac
  fi
  for word in $offer; do
    case $word in
      FILES) compopt -o filenames 2> /dev/null
        case $cur in
          @*) mapfile -t COMPREPLY < <(compgen -P @ -f -- "${{cur#@}}") ;;
          *) mapfile -t COMPREPLY < <(compgen -f -- "$cur") ;;
        esac ;;
      FOLDERS) compopt -o filenames 2> /dev/null; mapfile -t COMPREPLY < <(compgen -d -- "$cur") ;;
      NOTHING) ;;
      *) words+=" $word" ;;
    esac
  done
  COMPREPLY+=($(compgen -W "$words" -- "$cur"))
}}
complete -F _hrsi hrsi
