#compdef hrsi
# Completion of hrsi for zsh. For now:  source <(hrsi completion zsh)
# For good:  hrsi completion zsh > "${{fpath[1]}}/_hrsi"
_hrsi_words_or_files() {{ _alternative "words:word:($*)" "files:file:_files" }}
_hrsi() {{
  local -a commands=(
{commands}
  )
  if (( CURRENT == 2 )); then
    _describe -t commands 'algorithm' commands
    return
  fi
  local command=$words[2]
  shift words
  (( CURRENT-- ))
  case $command in
    help) _arguments '1:algorithm:({algorithms})' ;;
    completion) _arguments '1:shell:({shells})' ;;
{cases}
  esac
}}
if [ "$funcstack[1]" = _hrsi ]; then _hrsi "$@"; else compdef _hrsi hrsi; fi
