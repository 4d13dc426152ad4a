#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the Debian 12 packages that envbake needs, where any is missing.
#   install_packages.sh           to build and to test
#   install_packages.sh --clang   clang 14 and clang-format as well
set -euo pipefail

packages=(
    cmake dpkg-dev g++ git make ninja-build pkg-config
    libopenimageio-dev libopenexr-dev libembree-dev libtbb-dev libglm-dev libtinygltf-dev
    libdraco-dev libmeshoptimizer-dev libcli11-dev nlohmann-json3-dev libzstd-dev libxxhash-dev
    libgtest-dev libbenchmark-dev python3-numpy
)
if [[ "${1:-}" == --clang ]]; then
    packages+=(clang-14 clang-format-14 libclang-rt-14-dev)
fi

missing=()
for package in "${packages[@]}"; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done
if ((${#missing[@]} == 0)); then
    exit 0
fi

as_root=()
if ((EUID != 0)); then
    as_root=(sudo)
fi
echo "installing: ${missing[*]}"
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
