#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds with Debian 13's packages (Embree 4.3, GCC 14) and runs the tests of tracing and transport
# there. Warnings are no errors: GCC 14 sees overflows in std::vector that are none. Needs root and
# debootstrap; makes the tree on the first run, 2 GB.
#   debian13.sh FOLDER
set -euo pipefail
tree=${1:?a folder for the Debian 13 tree}
source=$(cd "$(dirname "$0")/.." && pwd)

if [[ ! -e $tree/usr/bin/apt-get ]]; then
    debootstrap --variant=minbase trixie "$tree"
fi
mkdir -p "$tree/src" "$tree/build"
mounts=(src proc dev)
unmount() { for m in "${mounts[@]}"; do umount "$tree/$m" 2>/dev/null || true; done; }
trap unmount EXIT
mount --bind "$source" "$tree/src"
mount --bind /proc "$tree/proc"
mount --bind /dev "$tree/dev"

chroot "$tree" /src/examples/install_packages.sh
chroot "$tree" bash -euc '
    cmake -S /src -B /build -G Ninja -DCMAKE_BUILD_TYPE=Release -DENVBAKE_WERROR=OFF
    cmake --build /build
    grep -i "embree_DIR" /build/CMakeCache.txt
    ctest --test-dir /build --output-on-failure -R "unit/(trace|transport)"'
