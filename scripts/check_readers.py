#!/usr/bin/env python3
"""The tables of a run in; whether old and new readers of Parquet all open them and see the same values, out.

    scripts/check_readers.sh pipelines/citation/out [--cache target/readers] [--only polars]

Every reader is installed into a folder of its own (`pip install --target`), which later runs use again, and opens every file and every
dataset in a process of its own. What it sees is compared with the reference, the first reader of the list, column by column: name, type,
number of nulls, and a digest of all values. Exit code 0: all that could be installed agree; what could not is named. Exit code 1: a reader
fails, or sees something else.
"""

import argparse
import concurrent.futures
import glob
import hashlib
import json
import os
import subprocess
import sys
import time

# Name, requirements, latest Python that it was built for. The first is the reference.
READERS = [
    ("pyarrow-latest", ["pyarrow", "numpy"], None),
    ("pyarrow-14", ["pyarrow==14.0.2", "numpy<2"], (3, 12)),
    ("pyarrow-11", ["pyarrow==11.0.0", "numpy<2"], (3, 11)),
    ("polars-1.0", ["polars==1.0.0", "numpy<2"], (3, 12)),
    ("polars-1.31", ["polars==1.31.0", "numpy"], None),
    ("polars-latest", ["polars>=2", "numpy"], None),
    ("duckdb-1.0", ["duckdb==1.0.0", "numpy<2"], (3, 12)),
    ("duckdb-latest", ["duckdb", "numpy"], None),
    ("fastparquet-latest", ["fastparquet", "pandas", "numpy"], None),
]
# The latest version is looked for again after so many days.
FRESH_S = 7 * 24 * 3600


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("out", help="output folder of a run")
    arguments.add_argument("--cache", default=os.path.join(os.path.dirname(__file__), "..", "target", "readers"))
    arguments.add_argument("--only", default="", help="besides the reference, readers whose name begins so")
    arguments.add_argument("--child", help=argparse.SUPPRESS)
    given = arguments.parse_args()
    if given.child:
        json.dump(seen(given.child, given.out), sys.stdout)
        return 0
    files = sorted(glob.glob(os.path.join(given.out, "**", "*.parquet"), recursive=True))
    if not files:
        print(f"there is no table in {given.out}: run the pipeline first")
        return 1
    wanted = [r for i, r in enumerate(READERS) if i == 0 or r[0].startswith(given.only)]
    folders = installed(os.path.abspath(given.cache), wanted)
    if not folders:
        return 0
    size = sum(os.path.getsize(f) for f in files)
    print(f"{len(files)} files, {size / 1e6:.1f} MB, opened by {len(folders)} readers", flush=True)
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        found = dict(zip(folders, pool.map(lambda name: asked(name, folders[name], given.out), folders)))
    return told(found, len(wanted))


def installed(cache, wanted):
    """Folders of the readers that are there or could be installed, by name."""
    folders = {}
    for name, requirements, newest in wanted:
        if newest and sys.version_info[:2] > newest:
            print(f"  {name:20} skipped: needs Python {newest[0]}.{newest[1]} or older")
            continue
        folder = os.path.join(cache, f"{name}-py{sys.version_info[0]}{sys.version_info[1]}")
        done = os.path.join(folder, "installed")
        stale = name.endswith("latest") and os.path.exists(done) and time.time() - os.path.getmtime(done) > FRESH_S
        if os.path.exists(done) and not stale:
            folders[name] = folder
            continue
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary=:all:", "--upgrade"]
        pip += ["--retries", "1", "--timeout", "20", "--target", folder]
        result = subprocess.run(pip + requirements, capture_output=True, text=True, stdin=subprocess.DEVNULL)
        if result.returncode == 0:
            with open(done, "w", encoding="utf-8") as file:
                file.write("\n".join(requirements) + "\n")
            folders[name] = folder
        elif stale:
            folders[name] = folder
        else:
            why = (result.stderr.strip().splitlines() or ["pip says nothing"])[-1]
            print(f"  {name:20} skipped: it cannot be installed ({why})")
            if name == READERS[0][0]:
                print("skipped: without the reference (is PyPI within reach?) there is nothing to compare with")
                return {}
    return folders


def asked(name, folder, out):
    """What a reader sees, from a process of its own: seconds and the answer, or what went wrong."""
    begin = time.time()
    environment = dict(os.environ, PYTHONPATH=folder, POLARS_MAX_THREADS="2", PYTHONDONTWRITEBYTECODE="1")
    command = [sys.executable, "-S", "-s", os.path.abspath(__file__), out, "--child", name]
    result = subprocess.run(command, capture_output=True, text=True, env=environment, stdin=subprocess.DEVNULL)
    if result.returncode != 0:
        lines = result.stderr.strip().splitlines()[-3:] or [f"it ended with code {result.returncode}"]
        return time.time() - begin, None, " ".join(line.strip() for line in lines)
    return time.time() - begin, json.loads(result.stdout), None


def told(found, of):
    """Prints what every reader saw; the exit code."""
    reference = found[READERS[0][0]][1]
    failed = 0
    for name, (seconds, answer, wrong) in found.items():
        faults = [wrong] if answer is None else answer["faults"]
        if answer is not None and reference is not None:
            for what in ["files", "sets"]:
                # what is missing has a fault already
                both = [{k: d[what][k] for k in answer[what] if k in d[what]} for d in (reference, answer)]
                faults = faults + differences(*both)
        version = f" ({answer['version']})" if answer else ""
        print(f"  {name:20} {'reads all the same' if not faults else 'FAILS'}{version} in {seconds:.1f} s")
        for fault in faults[:10]:
            print(f"      {fault}")
        if len(faults) > 10:
            print(f"      and {len(faults) - 10} more")
        failed += bool(faults)
    print(f"{len(found) - failed} readers agree, {failed} do not, {of - len(found)} skipped")
    return 1 if failed else 0


def differences(reference, answer):
    """One line for everything that differs between two nested dictionaries."""
    lines = []
    for key in sorted(set(reference) | set(answer)):
        if key not in answer or key not in reference:
            lines.append(f"{key}: {'missing' if key not in answer else 'not in the reference'}")
        elif isinstance(reference[key], dict):
            lines += [f"{key}: {line}" for line in differences(reference[key], answer[key])]
        elif reference[key] != answer[key]:
            lines.append(f"{key}: {answer[key]}, the reference has {reference[key]}")
    return lines


# --- in the reader's own process: files and datasets in, what they hold out ---


def seen(name, out):
    """Version; per file rows and columns; per dataset rows and flights; what could not be read."""
    reader = {"pyarrow": PyArrow, "polars": Polars, "duckdb": DuckDB, "fastparquet": FastParquet}[name.split("-")[0]]()
    files, sets, faults = {}, {}, []
    for path in sorted(glob.glob(os.path.join(out, "**", "*.parquet"), recursive=True)):
        key = os.path.relpath(path, out)
        try:
            files[key] = dict(told_of(reader.columns(path)))
        except Exception as e:  # whatever a reader throws is its answer
            faults.append(f"{key}: {type(e).__name__}: {' '.join(str(e).split())[:200]}")
    for table in sorted(os.listdir(out)):
        folder = os.path.join(out, table)
        parts = glob.glob(os.path.join(folder, "**", "*.parquet"), recursive=True)
        if not parts:
            continue
        try:
            rows, flights = reader.dataset(folder, any("flight=" in part for part in parts))
            sets[table] = {"rows": int(rows), "flights": sorted(map(str, flights))}
        except Exception as e:
            faults.append(f"{table}/: {type(e).__name__}: {' '.join(str(e).split())[:200]}")
    return {"version": reader.version, "files": files, "sets": sets, "faults": faults}


def told_of(columns):
    for name, values in columns:
        try:
            yield name, described(*values)
        except Exception as e:
            raise RuntimeError(f"column {name}: {type(e).__name__}: {e}") from e


def described(kind, values, null):
    """Type, rows, nulls and digest of a column: `values` an array, for texts a list; `null` where a row has no value."""
    import numpy

    digest = hashlib.blake2b(digest_size=16)
    if kind == "string":
        numbers = {}
        codes = [-1 if value is None else numbers.setdefault(value, len(numbers)) for value in values]
        digest.update("\0".join(numbers).encode())
        nulls = codes.count(-1)
        values = numpy.array(codes, dtype="<i8")
    else:
        nulls = int(null.sum())
        values = numpy.array(values, dtype={"f64": "<f8", "i64": "<i8", "bool": "u1"}[kind])
        values[null] = 0
        digest.update(numpy.packbits(null).tobytes())
        if kind == "f64" and numpy.isnan(values).any():
            raise ValueError("NaN, where no value is null")
    digest.update(values.tobytes())
    return {"kind": kind, "rows": len(values), "nulls": nulls, "digest": digest.hexdigest()}


class PyArrow:
    def __init__(self):
        import pyarrow

        self.version = pyarrow.__version__

    def columns(self, path):
        import pyarrow
        import pyarrow.parquet

        table = pyarrow.parquet.ParquetFile(path).read()
        for name in table.column_names:
            column = table.column(name)
            kind = {"double": "f64", "int64": "i64", "bool": "bool", "string": "string"}[str(column.type)]
            null = column.is_null().to_numpy()
            if kind == "string":
                coded = column.combine_chunks().dictionary_encode()
                coded = coded.combine_chunks() if isinstance(coded, pyarrow.ChunkedArray) else coded
                words = coded.dictionary.to_pylist() + [None]
                yield name, (kind, [words[k] for k in coded.indices.fill_null(len(words) - 1).to_pylist()], null)
            else:
                yield name, (kind, column.fill_null(False if kind == "bool" else 0).to_numpy(), null)

    def dataset(self, folder, flights):
        import pyarrow.parquet

        table = pyarrow.parquet.read_table(folder)
        return table.num_rows, table.column("flight").unique().to_pylist() if flights else []


class Polars:
    def __init__(self):
        import polars

        self.version = polars.__version__

    def columns(self, path):
        import polars

        table = polars.read_parquet(path, hive_partitioning=False)
        for column in table.iter_columns():
            kind = {"Float64": "f64", "Int64": "i64", "Boolean": "bool", "String": "string"}[str(column.dtype)]
            null = column.is_null().to_numpy()
            if kind == "string":
                yield column.name, (kind, column.to_list(), null)
            else:
                yield column.name, (kind, column.fill_null(False if kind == "bool" else 0).to_numpy(), null)

    def dataset(self, folder, flights):
        import polars

        table = polars.read_parquet(os.path.join(folder, "**", "*.parquet"), hive_partitioning=flights)
        return table.height, table["flight"].unique().to_list() if flights else []


class DuckDB:
    def __init__(self):
        import duckdb

        self.version = duckdb.__version__
        self.connection = duckdb.connect()

    def columns(self, path):
        import numpy

        asked = self.connection.execute("SELECT * FROM read_parquet(?, hive_partitioning = false)", [path])
        kinds = {str(c[0]): str(c[1]) for c in asked.description}
        for name, values in asked.fetchnumpy().items():
            kind = {"f": "f64", "i": "i64", "b": "bool", "O": "string"}[values.dtype.kind]
            null = numpy.ma.getmaskarray(values)
            values = numpy.ma.getdata(values)
            if kind == "string":
                if "STRING" not in kinds[name].upper() and "VARCHAR" not in kinds[name].upper():
                    raise TypeError(f"{name} is {kinds[name]}")
                yield name, (kind, [None if gone else value for gone, value in zip(null.tolist(), values.tolist())], null)
            else:
                yield name, (kind, values, null)

    def dataset(self, folder, flights):
        path = os.path.join(folder, "**", "*.parquet")
        source = f"read_parquet(?, hive_partitioning = {str(flights).lower()}, union_by_name = true)"
        (rows,) = self.connection.execute(f"SELECT count(*) FROM {source}", [path]).fetchone()
        if not flights:
            return rows, []
        return rows, [row[0] for row in self.connection.execute(f"SELECT DISTINCT flight FROM {source}", [path]).fetchall()]


class FastParquet:
    def __init__(self):
        import fastparquet

        self.version = fastparquet.__version__

    def columns(self, path):
        import fastparquet

        table = fastparquet.ParquetFile(path).to_pandas()
        for name in table.columns:
            column = table[name]
            kinds = {"float64": "f64", "int64": "i64", "bool": "bool", "boolean": "bool"}
            kind = kinds.get(str(column.dtype).lower(), "string")
            # pandas has no null in a float64: a missing number is NaN here
            null = column.isna().to_numpy(dtype=bool)
            if kind == "string":
                yield name, (kind, [None if gone else value for gone, value in zip(null.tolist(), column.tolist())], null)
            else:
                yield name, (kind, column.fillna(False if kind == "bool" else 0).to_numpy(), null)

    def dataset(self, folder, flights):
        import fastparquet

        file = fastparquet.ParquetFile(folder)
        # of files without rows it does not keep the partition
        return file.count(), file.cats.get("flight", []) if flights else []


if __name__ == "__main__":
    sys.exit(main())
