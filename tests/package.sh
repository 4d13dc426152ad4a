#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Uses envbake as strangers do, from outside its tree: installed (find_package, envbake_bake,
# pkg-config, completions, man pages), as a .deb, and by add_subdirectory.
#   tests/package.sh BUILD_FOLDER    of a complete build
set -euo pipefail
source=$(cd "$(dirname "$0")/.." && pwd)
build=$(cd "$1" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

fail() {
    printf 'package.sh: %s\n' "$*" >&2
    exit 1
}
quietly() { "$@" >log 2>&1 || { cat log >&2; fail "failed: $*"; }; }

# Not under the prefix it was configured for: everything in it is relative.
quietly cmake --install "$build" --prefix "$work/a prefix"
mv "a prefix" "prefix"
cp -r "$source/examples" examples

# Both generators; the second call of each has nothing to do, the third one asset that is newer.
consume() {  # GENERATOR TOOL PREFIX
    quietly cmake -G "$1" -S examples/bake_in_build -B "use $2" -DCMAKE_PREFIX_PATH="$3" \
        -DASSETS="$work/my assets"
    quietly cmake --build "use $2" --parallel 3
    "use $2/read-bundle" "use $2/levels/scene.envb" >/dev/null
    "use $2/read-bundle" "use $2/levels/sky.envb" >/dev/null
    local time
    time=$(stat -c %y "use $2/levels/scene.envb")
    quietly cmake --build "use $2"
    if grep -q Baking log; then fail "$2 bakes what nothing has changed"; fi
    touch "$work/my assets/sky.hdr"
    quietly cmake --build "use $2"
    grep -q Baking log || fail "$2 does not look at an environment that is newer"
    [[ $(stat -c %y "use $2/levels/scene.envb") == "$time" ]] || fail "$2: the same was baked again"
}
if [[ -x prefix/bin/envbake ]]; then
    mkdir "my assets"
    quietly "$build/bin/envbake-sample" "my assets"
    consume Ninja ninja "$work/prefix"
    consume "Unix Makefiles" make "$work/prefix"
    cmp "use ninja/levels/scene.envb" "use make/levels/scene.envb"

    . prefix/share/bash-completion/completions/envbake
    COMP_WORDS=(envbake bake --depf) COMP_CWORD=2
    _envbake
    [[ ${COMPREPLY[*]} == --depfile ]] || fail "bash completes --depf to: ${COMPREPLY[*]}"
    COMP_WORDS=(envbake bake --preset re) COMP_CWORD=3
    _envbake
    [[ ${COMPREPLY[*]} == reference ]] || fail "bash completes --preset re to: ${COMPREPLY[*]}"
    if command -v zsh >/dev/null; then zsh -n prefix/share/zsh/site-functions/_envbake; fi
    for command in $(prefix/bin/envbake --help | sed -n 's/^  \([a-z]*\)  .*/\1/p'); do
        grep -q '^.SH NAME' "prefix/share/man/man1/envbake-$command.1" || fail "no man page: $command"
    done
    # Every option of every page: as many as the help has.
    [[ $(grep -c '^\\fB\\-' prefix/share/man/man1/envbake-bake.1) == \
        $(prefix/bin/envbake bake --help | grep -c '^  -') ]] || fail "options are missing in man pages"
fi

# pkg-config, on what the .deb holds.
quietly cpack --config "$build/CPackConfig.cmake" -B deb
dpkg-deb -x deb/*.deb unpacked
config=$(find unpacked -name pkgconfig)
export PKG_CONFIG_PATH=$work/$config
g++ -std=c++20 examples/read_bundle/main.cpp $(pkg-config --cflags --libs envbake) -o by-pkg-config
gcc -std=c99 -c examples/read_bundle/main.c $(pkg-config --cflags envbake) -o main.o
g++ main.o $(pkg-config --libs envbake) -o from-c
if [[ -e "use ninja/levels/scene.envb" ]]; then
    ./by-pkg-config "use ninja/levels/scene.envb" >/dev/null
    ./from-c "use ninja/levels/scene.envb" >/dev/null
    unpacked/usr/bin/envbake validate "use ninja/levels/scene.envb" >/dev/null
fi

# The sources in another project: only the runtime is built, nothing is installed with it.
cat >CMakeLists.txt <<EOF
cmake_minimum_required(VERSION 3.25)
project(engine LANGUAGES CXX)
add_subdirectory($source/runtime_min runtime)
add_executable(engine examples/read_bundle/main.cpp)
target_link_libraries(engine PRIVATE envbake::runtime_min)
install(TARGETS engine)
EOF
quietly cmake -G Ninja -S . -B engine-build
quietly cmake --build engine-build
quietly cmake --install engine-build --prefix engine-prefix
[[ $(find engine-prefix -type f | wc -l) == 1 ]] || fail "add_subdirectory installs more than the engine"
echo "package.sh: done"
