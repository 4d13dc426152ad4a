#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes man pages and shell completions from what `envbake --help` prints, so that neither can say
# anything else.
#   from_help.sh ENVBAKE FOLDER    writes FOLDER/man1, FOLDER/bash, FOLDER/zsh
set -euo pipefail
export LC_ALL=C

envbake=$1
folder=$2
here=$(dirname "$0")

# Records of one help text, tab-separated: `option NAMES VALUE TEXT`, `positional NAME VALUE TEXT`,
# `command NAME - TEXT`, `text - - LINE` for everything else. (- stands for nothing.)
records() {
    "$envbake" "$@" --help | awk -f "$here/help_records.awk"
}

mkdir -p "$folder/man1" "$folder/bash" "$folder/zsh"
version=$("$envbake" version)
commands=$(records | awk -F'\t' '$1 == "command" { print $2 }')

man_page() { awk -F'\t' -v name="$1" -v version="$version" -f "$here/help_man.awk"; }
records | man_page envbake >"$folder/man1/envbake.1"
for command in $commands; do
    records "$command" | man_page "envbake-$command" >"$folder/man1/envbake-$command.1"
done

# The program's records come first, marked with "-" for their command.
all_records() {
    records | sed 's/^/-\t/'
    for command in $commands; do records "$command" | sed "s/^/$command\t/"; done
}
all_records | awk -F'\t' -f "$here/help_bash.awk" >"$folder/bash/envbake"
all_records | awk -F'\t' -f "$here/help_zsh.awk" >"$folder/zsh/_envbake"
