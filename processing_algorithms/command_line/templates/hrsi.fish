# Completion of hrsi for fish. For now:  hrsi completion fish | source
# For good:  hrsi completion fish > ~/.config/fish/completions/hrsi.fish
complete -c hrsi -f
{lines}
