#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints in one line what a run of the benchmarks was made on: machine, compiler, libraries, commit,
date. Standard library only.

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


def embree_version(cache):
    folder = Path(found(r"^embree_DIR:PATH=(.*)$", cache, "/nowhere"))
    for file in sorted(folder.glob("*version.cmake")):
        return found(r'(?i)set *\( *PACKAGE_VERSION *"?([\d.]+)', file.read_text(encoding="utf-8"))
    return "unknown"


def processor():
    info = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    flags = found(r"^flags\s*:\s*(.*)$", info, "").split()
    vectors = next((name for flag, name in (("avx512f", "AVX-512"), ("avx2", "AVX2")) if flag in flags), "no AVX2")
    model, family, number = (found(rf"^{key}\s*:\s*(.*)$", info) for key in ("model name", "cpu family", "model"))
    return f"{model} (family {family}, model {number}, {vectors})"


def main():
    cache = (ROOT / "build/bench/CMakeCache.txt").read_text(encoding="utf-8")
    compiler = output(found(r"^CMAKE_CXX_COMPILER:\w+=(.*)$", cache), "--version").splitlines()[0]
    memory = int(found(r"^MemTotal:\s*(\d+)", Path("/proc/meminfo").read_text(encoding="utf-8"))) / 2**20
    changed = output("git", "status", "--porcelain", "--untracked-files=no", "--", "*.cpp", "*.h", "*CMakeLists.txt")
    print(f"{processor()}, {os.cpu_count()} threads, {memory:.0f} GiB; {compiler}, -march={found(r'^ENVBAKE_ARCH:.*=(.*)$', cache)}; "
          f"Embree {embree_version(cache)}, OpenImageIO {found(r'^OpenImageIO_VERSION:INTERNAL=(.*)$', cache)}; "
          f"commit {output('git', 'rev-parse', '--short', 'HEAD').strip()}{' with changes' if changed else ''}, "
          f"{datetime.date.today()}, {sys.argv[1]} run")


main()
