"""`rmr completion`: the script by which a shell completes the words of all programs."""

from rmr.commands.common import print_octets
from rmr.entry.command_line import Command, Parser, one_of
from rmr.entry.completion import FILES, VARIABLE

SCRIPTS = {
    "bash": """\
_rmr() {
  local line files=
  COMPREPLY=()
  while IFS= read -r line; do
    if [[ $line == FILES ]]; then files=1; else COMPREPLY+=("${line%%$'\\t'*}"); fi
  done < <(VARIABLE=1 "${COMP_WORDS[0]/#~/$HOME}" "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
  if [[ $files ]]; then
    compopt -o filenames 2>/dev/null
    while IFS= read -r line; do COMPREPLY+=("$line"); done < <(compgen -f -- "${COMP_WORDS[COMP_CWORD]#=}")
  fi
}
complete -F _rmr PROGRAMS
""",
    "zsh": """\
#compdef PROGRAMS
_rmr() {
  local line value files=
  local -a found
  for line in "${(@f)$(VARIABLE=1 ${~words[1]} "${(@Q)words[2,CURRENT]}" 2>/dev/null)}"; do
    value=${line%%$'\\t'*}
    if [[ $line == FILES ]]; then files=1
    elif [[ $line == *$'\\t'* ]]; then found+=("${value//:/\\\\:}:${line#*$'\\t'}")
    elif [[ -n $line ]]; then found+=("${value//:/\\\\:}"); fi
  done
  (( $#found )) && _describe rmr found
  [[ -n $files ]] && _files
}
if [[ $funcstack[1] == _rmr ]]; then _rmr; else compdef _rmr PROGRAMS; fi
""",
    "fish": """\
function __rmr_complete
    set -l words (commandline -opc)
    set -l current (commandline -ct)
    for line in (env VARIABLE=1 $words "$current" 2>/dev/null)
        if test "$line" = FILES
            __fish_complete_path "$current"
        else
            echo $line
        end
    end
end
for program in PROGRAMS
    complete -c $program -f -a '(__rmr_complete)'
end
""",
}
"""Shell -> its script."""


def _declare(parser: Parser) -> None:
    parser.positional("shell", "|".join(SCRIPTS), read=one_of(list(SCRIPTS)), usage="SHELL")


def _print(shell: str) -> None:
    words = {"VARIABLE": VARIABLE, "FILES": FILES, "PROGRAMS": "rmr rmrc rmr-agent rmr-world"}
    script = SCRIPTS[shell]
    for word, meant in words.items():
        script = script.replace(word, meant)
    print_octets(script.encode())


command = Command(
    """\
Print the script by which SHELL completes commands, options and labs: bash, zsh or fish.

For the shell that runs:

  bash   source <(rmr completion bash)
  zsh    source <(rmr completion zsh)
  fish   rmr completion fish | source

The same line in ~/.bashrc, in ~/.zshrc below compinit, or in ~/.config/fish/config.fish does so for all to come.""",
    _declare,
    _print,
)
