# SPDX-License-Identifier: Apache-2.0
# Records of one help text -> one man page (groff, man macros).
function escaped(text) {
    gsub(/\\/, "\\e", text)
    gsub(/-/, "\\-", text)
    if (text ~ /^[.']/) text = "\\&" text
    return text
}
function add(title, text) { body[title] = body[title] text "\n" }
function add_entry(title, name, value, text) {
    name = "\\fB" escaped(name) "\\fR"
    add(title, ".TP\n" name (value == "-" ? "" : " \\fI" escaped(value) "\\fR") "\n" escaped(text))
}

$1 == "positional" { add_entry("ARGUMENTS", $2, $3, $4) }
$1 == "option" { add_entry("OPTIONS", $2, $3, $4) }
$1 == "command" { add_entry("COMMANDS", $2, $3, $4) }
$1 != "text" || $4 == "" { next }

!named {  # the first line of a help text is what the command does
    named = 1
    what = $4
    sub(/^envbake /, "", what)
    add("NAME", escaped(name) " \\- " escaped(what))
    next
}
$4 ~ /^Usage: / { add("SYNOPSIS", escaped(substr($4, 8))); next }
# Examples and exit statuses, line by line as they are.
{ add("SYNOPSIS" in body ? "NOTES" : "DESCRIPTION", ".nf\n" escaped($4) "\n.fi") }

END {
    add("SEE ALSO", name == "envbake" ? "\\fBenvbake\\-COMMAND\\fR(1)" : "\\fBenvbake\\fR(1)")
    printf ".TH \"%s\" 1 \"\" \"%s\" \"\"\n", toupper(name), version
    count = split("NAME,SYNOPSIS,DESCRIPTION,ARGUMENTS,COMMANDS,OPTIONS,NOTES,SEE ALSO", titles, ",")
    for (i = 1; i <= count; ++i)
        if (titles[i] in body) printf ".SH %s\n%s", titles[i], body[titles[i]]
}
