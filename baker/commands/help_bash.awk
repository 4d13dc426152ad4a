# SPDX-License-Identifier: Apache-2.0
# Records of all help texts, each behind its command -> completion for bash.
function choices(value) {  # TEXT:{a,b}=a -> "a b"
    if (!match(value, /\{[^}]*\}/)) return ""
    value = substr(value, RSTART + 1, RLENGTH - 2)
    gsub(/,/, " ", value)
    return value
}
$2 == "command" { commands = commands " " $3 }
$2 == "option" {
    names = $3
    gsub(/,/, " ", names)
    options[$1] = options[$1] " " names
    if (!($1 in seen)) order[++count] = $1
    seen[$1] = 1
    if ((words = choices($4)) != "") {
        gsub(/ /, "|" $1 ":", names)
        values = values sprintf("        %s:%s) words=\"%s\" ;;\n", $1, names, words)
    }
}
END {
    print "# Completion of envbake for bash; made from its --help.\n_envbake() {"
    print "    local current=${COMP_WORDS[COMP_CWORD]} words="
    print "    case ${COMP_WORDS[1]}:${COMP_WORDS[COMP_CWORD-1]} in\n" values "    esac"
    print "    if [[ -z $words ]] && ((COMP_CWORD == 1)); then"
    print "        words=\"" substr(commands, 2) options["-"] "\""
    print "    elif [[ -z $words && $current == -* ]]; then\n        case ${COMP_WORDS[1]} in"
    for (i = 1; i <= count; ++i)
        if (order[i] != "-")
            printf "            %s) words=\"%s\" ;;\n", order[i], substr(options[order[i]], 2)
    print "        esac\n    fi"
    print "    mapfile -t COMPREPLY < <(compgen -W \"$words\" -- \"$current\")\n}"
    print "# Where nothing fits: names of files.\ncomplete -o default -F _envbake envbake"
}
