#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints in one line what a run of the benchmarks was made on: machine, compiler, libraries, commit,
date, load. Standard library only.

    machine.py quick|full
"""
import datetime
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def found(pattern, text, default="unknown"):
    match = re.search(pattern, text, re.MULTILINE)
    return match.group(1).strip() if match else default


def output(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout


def package_version(cache, package):
    """Of a package that CMake found by its config file."""
    folder = Path(found(rf"^{package}_DIR:PATH=(.*)$", cache, "/nowhere"))
    for file in sorted(folder.glob("*[cC]onfig*.cmake")):
        version = found(r'set *\( *(?:PACKAGE_VERSION|EMBREE_VERSION) *"?([\d.]+)', file.read_text(encoding="utf-8"), "")
        if version:
            return version
    return "of unknown version"


def main():
    cache = (ROOT / "build/bench/CMakeCache.txt").read_text(encoding="utf-8")
    compiler = output(found(r"^CMAKE_CXX_COMPILER:\w+=(.*)$", cache), "--version").splitlines()[0]
    cpu = found(r"^model name\s*:\s*(.*)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"))
    memory = int(found(r"^MemTotal:\s*(\d+)", Path("/proc/meminfo").read_text(encoding="utf-8"))) / 2**20
    changed = output("git", "status", "--porcelain", "--untracked-files=no", "--", "*.cpp", "*.h", "*CMakeLists.txt")
    load = os.getloadavg()
    print(f"{cpu}, {os.cpu_count()} threads, {memory:.0f} GiB; {compiler}, -march={found(r'^ENVBAKE_ARCH:.*=(.*)$', cache)}; "
          f"Embree {package_version(cache, 'embree')}, OpenImageIO {package_version(cache, 'OpenImageIO')}; "
          f"commit {output('git', 'rev-parse', '--short', 'HEAD').strip()}{' with changes' if changed else ''}, "
          f"{datetime.date.today()}, {sys.argv[1]} run; load average of 15 minutes {load[2]:.1f}")


main()
