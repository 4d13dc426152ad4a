# SPDX-License-Identifier: Apache-2.0
# Records of all help texts, each behind its command -> completion for zsh.
function quoted(text) {
    gsub(/'/, "'\\''", text)
    return text
}
function described(text) {
    gsub(/\\|\[|\]|:/, "\\\\&", text)
    return quoted(text)
}
function choices(value) {
    if (!match(value, /\{[^}]*\}/)) return "_files"
    value = substr(value, RSTART + 1, RLENGTH - 2)
    gsub(/,/, " ", value)
    return "(" value ")"
}
# "-", or what a flag may exclude, is no value.
function takes_value(value) { return value != "-" && value !~ /^(Excludes|Needs|REQUIRED)/ }
$2 == "command" { commands = commands sprintf("        '%s:%s'\n", $3, described($5)) }
$2 == "option" {
    if (!($1 in specs)) order[++count] = $1
    n = split($3, names, ",")
    for (k = 1; k <= n; ++k) {
        spec = "*" names[k] "[" described($5) "]"
        times = 1
        if (match($4, / x [0-9]+/)) times = substr($4, RSTART + 3, RLENGTH - 3)
        if (takes_value($4))
            for (; times > 0; --times) spec = spec ":value:" choices($4)
        specs[$1] = specs[$1] " \\\n                '" spec "'"
    }
}
END {
    print "#compdef envbake\n# Completion of envbake for zsh; made from its --help.\n_envbake() {"
    print "    local -a commands=(\n" commands "    )"
    print "    if ((CURRENT == 2)); then\n        _describe command commands\n        return\n    fi"
    print "    local command=$words[2]\n    shift words\n    ((CURRENT--))\n    case $command in"
    for (i = 1; i <= count; ++i)
        if (order[i] != "-")
            print "        " order[i] ")\n            _arguments" specs[order[i]] " \\\n" \
                  "                '*:file:_files' ;;"
    print "    esac\n}\n_envbake \"$@\""
}
