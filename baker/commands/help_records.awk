# SPDX-License-Identifier: Apache-2.0
# Help of CLI11: names in columns 3 to 29, text from column 31; names too long for that stand on a
# line of their own, above their text.
{ line[NR] = $0 }

function emit(entry, text,    space, name, value, kind) {
    space = index(entry, " ")
    name = space ? substr(entry, 1, space - 1) : entry
    value = space ? substr(entry, space + 1) : ""
    kind = section == "Positionals" ? "positional" : section == "Subcommands" ? "command" : "option"
    print kind "\t" name "\t" (value == "" ? "-" : value) "\t" text
}

END {
    for (i = 1; i <= NR; ++i) {
        if (line[i] ~ /^[A-Z][A-Za-z ]*:$/ && line[i] != "Example:") {
            section = substr(line[i], 1, length(line[i]) - 1)
        } else if (section != "" && line[i] ~ /^  [^ ]/) {
            if (line[i + 1] ~ /^                              [^ ]/) {
                emit(substr(line[i], 3), substr(line[i + 1], 31))
                ++i
            } else {
                entry = substr(line[i], 3, 28)
                sub(/ +$/, "", entry)
                emit(entry, substr(line[i], 31))
            }
        } else {
            if (line[i] != "") section = ""
            print "text\t-\t-\t" line[i]
        }
    }
}
