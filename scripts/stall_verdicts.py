#!/usr/bin/env python3
"""The stall of pipelines/attas-real with other smoothing, rates and block lengths in; the table of verdicts in its README out.

    KOEHLER_DATA=../shared/data scripts/stall_verdicts.py target/release/koehler [--jobs 2] [--check]

Each variant of stall.toml is diagnosed in a folder of its own (20 s of a core each). Needs polars. With --check the
README is compared, not written.
"""

import argparse
import concurrent.futures
import glob
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

import polars

FOLDER = pathlib.Path(__file__).resolve().parent.parent / "pipelines" / "attas-real"
START = "<!-- written by scripts/stall_verdicts.py -->\n"
END = "<!-- until here -->\n"
# rate, 1/s; smoothing of what moves fast, s (five points at least); blocks, s (48 at most, so 2.5 s at least). The first is stall.toml as it stands.
VARIANTS = [
    (10.0, 0.4, 2.5),
    (5.0, 1.0, 2.5),
    (25.0, 0.4, 2.5),
    (10.0, 0.0, 2.5),
    (10.0, 0.8, 2.5),
    (10.0, 1.0, 2.5),
    (10.0, 0.4, 3.0),
    (10.0, 0.4, 4.0),
    (10.0, 0.4, 5.0),
    (10.0, 0.4, 6.0),
]


def variant(text, rate, smooth, block):
    """stall.toml with other numbers; without smoothing only the airspeed is smoothed, as it is divided by."""
    text, n = re.subn(r"rate_hz = [\d.]+", f"rate_hz = {rate}", text)
    fast = "".join(f", {name} = {smooth}" for name in ["alpha", "p", "q", "r", "ax", "az", "de"]) if smooth else ""
    text, m = re.subn(r"smooth  = \{.*\}", f"smooth  = {{ V = 2.0{fast} }}", text)
    text, k = re.subn(r"block_s = [\d.]+", f"block_s = {block}", text)
    assert (n, m, k) == (1, 1, 1), "stall.toml has each number once"
    return text


def diagnosed(program, rate, smooth, block):
    """A row of the table."""
    with tempfile.TemporaryDirectory() as at:
        at = pathlib.Path(at)
        for file in FOLDER.glob("*.toml"):
            shutil.copy(file, at)
        text = variant((at / "stall.toml").read_text(), rate, smooth, block)
        (at / "stall.toml").write_text(text)
        for args in (["import", "import.toml"], ["diagnose", "stall.toml"]):
            done = subprocess.run([program, *args], cwd=at, capture_output=True, text=True)
            if done.returncode not in (0, 3):
                sys.exit(f"{args}: {done.stderr}")

        def table(name):
            parts = sorted(glob.glob(str(at / "out" / "stall" / name / "**" / "*.parquet"), recursive=True))
            return polars.read_parquet(parts)

        findings = table("findings")
        verdict = findings["verdict"][0]
        named = [name for name in findings["candidate"].to_list() if name]
        first = table("candidates").filter((polars.col("round") == 1) & ~polars.col("strict"))
        best = first.sort("screened", descending=True).row(0, named=True)
        stall = first.filter(polars.col("candidate") == "stall-separation").row(0, named=True)
    told = ", ".join(f"`{name}`" for name in named) or "-"
    smoothing = f"{smooth:g} s" if smooth else "none"
    return (
        f"| {rate:g} | {smoothing} | {block:g} s | {verdict} | {told} | `{best['candidate']}` {best['screened']:.1f} "
        f"| {stall['screened']:.1f}, {stall['standing']} | {stall['limit']:.1f} |\n"
    )


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("program")
    arguments.add_argument("--jobs", type=int, default=2)
    arguments.add_argument("--check", action="store_true")
    asked = arguments.parse_args()
    program = os.path.abspath(asked.program)
    with concurrent.futures.ThreadPoolExecutor(asked.jobs) as pool:
        rows = list(pool.map(lambda one: diagnosed(program, *one), VARIANTS))
    head = "| points/s | smoothing | blocks | verdict | effects told | screened first | separation screened | chance gives |\n|---|---|---|---|---|---|---|---|\n"
    readme = FOLDER / "README.md"
    text = readme.read_text()
    before, rest = text.split(START)
    wanted = before + START + head + "".join(rows) + END + rest.split(END, 1)[1]
    if asked.check and text != wanted:
        sys.exit("pipelines/attas-real/README.md is behind: run scripts/stall_verdicts.py without --check\n" + "".join(rows))
    readme.write_text(wanted)
    print("".join(rows))


if __name__ == "__main__":
    main()
