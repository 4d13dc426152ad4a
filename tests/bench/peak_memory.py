#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs a command and prints peak_mb,wall_s,cpu_s: the most that it and its children held together, in
MB (10^6 bytes), as the sum of their proportional set sizes, asked for every 5 ms and so a little too
small for what is short; seconds; CPU seconds of all of them. Exit status: the command's.

    peak_memory.py COMMAND...
"""
import resource
import subprocess
import sys
import time
from pathlib import Path


def family(pid):
    yield pid
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
        for task in Path(f"/proc/{pid}/task").iterdir():
            if task.name != str(pid):
                children += (task / "children").read_text(encoding="ascii").split()
    except OSError:
        return
    for child in children:
        yield from family(int(child))


def proportional_bytes(pid):
    try:
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines():
            if line.startswith("Pss:"):
                return 1024 * int(line.split()[1])
    except OSError:  # it has ended
        pass
    return 0


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    def cpu_seconds():
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    before, begin = cpu_seconds(), time.monotonic()  # whoever started this may have left children's time
    process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
    peak = 0
    while process.poll() is None:
        peak = max(peak, sum(proportional_bytes(pid) for pid in family(process.pid)))
        try:
            process.wait(0.005)
        except subprocess.TimeoutExpired:
            pass
    wall = time.monotonic() - begin
    print(f"{peak / 1e6:.1f},{wall:.3f},{cpu_seconds() - before:.3f}")
    sys.exit(process.returncode)


main()
