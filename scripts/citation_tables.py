#!/usr/bin/env python3
"""Prints the tables of pipelines/citation/README.md from the results of a run.

    koehler run pipelines/citation/pipeline.toml
    koehler run pipelines/citation/no-friction.toml      # for the columns without friction
    scripts/citation_tables.py pipelines/citation/out

Needs Python 3 with polars.
"""

import math
import sys
from pathlib import Path

import polars as pl

# Citation Eqs. 8-11, 14, 13 and 18-21: model, coefficient, condition, slope, intercept.
LINES = [
    ("elevator", "C_h_delta", "alpha", -0.3717, -0.3189),
    ("elevator", "C_h_deltadot", "alpha", -0.094, -0.017),
    ("elevator", "C_h_alpha", "alpha", -0.4229, -0.0107),
    ("elevator", "C_h_alphadot", "alpha", -0.0333, -0.0072),
    ("elevator", "C_h_0", "alpha", -0.39, 0.0216),
    ("elevator", "C_h_0", "delta_te", -0.6, 0.002),
    ("aileron", "C_ha_delta", "alpha", -0.705, -0.0795),
    ("aileron", "C_ha_deltadot", "alpha", -0.121, -0.0065),
    ("aileron", "C_ha_alpha", "alpha", -0.120, -0.0159),
    ("aileron", "C_ha_beta", "alpha", -0.3095, 0.0591),
]
# Citation Table 4: sd of one maneuver of 1 s, and of 0.5 s over it.
TABLE_4 = {
    "C_ha_delta": (0.0118, 1.57),
    "C_ha_alpha": (0.0024, 1.38),
    "C_ha_deltadot": (0.0005, 1.20),
    "C_ha_0": (4.6e-5, 1.02),
}
# Bands of nine lines that hold together with 95 %.
LEVEL = 1 - 0.05 / 9


def table(out: Path, name: str) -> pl.DataFrame:
    return pl.read_parquet(str(out / name / "**" / "*.parquet"), hive_partitioning=True)


def f_quantile(level: float, dof: float) -> float:
    """Quantile of F with 2 and `dof` degrees of freedom, in closed form."""
    return dof / 2 * ((1 - level) ** (-2 / dof) - 1)


def row_of(fits: pl.DataFrame, model: str, name: str, against: str):
    rows = fits.filter((pl.col("model") == model) & (pl.col("parameter") == name) & (pl.col("against") == against))
    return rows.row(0, named=True) if rows.height else None


def distance(line: dict, slope: float, intercept: float, level: float) -> float:
    """Largest distance from the true line where there are points, in half-widths of the simultaneous band."""
    ds, di = line["slope"] - slope, line["intercept"] - intercept
    vs, vi, c = line["slope_sd"] ** 2, line["intercept_sd"] ** 2, line["covariance"]
    width = math.sqrt(2 * f_quantile(level, line["n"] - 2))
    xs = [line["x_min"] + k / 50 * (line["x_max"] - line["x_min"]) for k in range(51)]
    return max(abs(di + ds * x) / (width * math.sqrt(vi + 2 * x * c + x * x * vs)) for x in xs)


def lines(out: Path) -> None:
    fits = table(out, "fits")
    without = out / "no-friction"
    without = table(without, "fits") if (without / "fits").is_dir() else fits.clear()
    print("| line | term | truth | estimate ± sd | in sd | of the half-width at 1 - 0.05/9 | at 0.95 | without friction ± sd | in sd |")
    print("|---|---|---|---|---|---|---|---|---|")
    for model, name, against, slope, intercept in LINES:
        line, other = (row_of(of, model, name, against) for of in (fits, without))
        for term, truth in (("slope", slope), ("intercept", intercept)):
            value, sd = line[term], line[term + "_sd"]
            bands = [f"{distance(line, slope, intercept, level):.2f}" for level in (LEVEL, 0.95)] if term == "slope" else ["", ""]
            rest = ["", ""]
            if other and other[term] is not None:
                rest = [f"{other[term]:.4g} ± {other[term + '_sd']:.2g}", f"{(other[term] - truth) / other[term + '_sd']:.1f}"]
            shown = [f"`{name}` over `{against}`" if term == "slope" else "", term, f"{truth}", f"{value:.4g} ± {sd:.2g}", f"{(value - truth) / sd:.1f}"]
            print("| " + " | ".join(shown + bands + rest) + " |")


def one_fit(out: Path) -> None:
    """The lines of one fit of all maneuvers beside those of two steps; intervals of 95 %: normal quantile there, Student's here."""
    fits, estimates = table(out, "fits"), table(out, "estimates")
    joint = estimates.filter((pl.col("model") == "elevator-lines") & pl.col("segment").is_null())
    joint = {row["parameter"]: row for row in joint.iter_rows(named=True)}
    print("| line | term | two steps ± sd | one fit ± sd | difference in sd | length of interval, one fit over two steps |")
    print("|---|---|---|---|---|---|")
    for model, name, against, _, _ in LINES:
        if model != "elevator" or against != "alpha":
            continue
        line = row_of(fits, model, name, against)
        for term, of in (("slope", "_slope"), ("intercept", "_0")):
            one, two, sd = joint[name + of], line[term], line[term + "_sd"]
            length = 1.95996 * one["sd"] / (2.04841 * sd)
            shown = [f"`{name}`", term, f"{two:.4g} ± {sd:.2g}", f"{one['value']:.4g} ± {one['sd']:.2g}", f"{(one['value'] - two) / sd:.2f}", f"{length:.2f}"]
            print("| " + " | ".join(shown) + " |")


def friction(out: Path) -> None:
    estimates = table(out, "estimates")
    for model, name in (("elevator-lines", "F_c"), ("aileron", "F_ca")):
        rows = estimates.filter((pl.col("model") == model) & (pl.col("parameter") == name))
        for row in rows.sort("group").iter_rows(named=True):
            print(f"{model} {name} {row['group']} {row.get('of') or ''}: {row['value']:.2f} ± {row['sd']:.2f} N, with the constants ± {row['sd_total']:.2f}")


def table_4(out: Path) -> None:
    estimates = table(out, "estimates")
    print("| | " + " | ".join(f"`{name}`" for name in TABLE_4) + " |")
    print("|---" * (len(TABLE_4) + 1) + "|")
    long = {}
    for model in ("aileron", "aileron-short"):
        for name in TABLE_4:
            rows = estimates.filter((pl.col("model") == model) & (pl.col("parameter") == name))
            long[model, name] = dict(rows.select("segment", "sd").iter_rows())
    speeds = dict(table(out, "conditions").filter(pl.col("signal") == "V").select("segment", "value").iter_rows())
    ratio = {name: median(long["aileron", name].values()) / TABLE_4[name][0] for name in TABLE_4}
    print("| Table 4 | " + " | ".join(f"{TABLE_4[name][0]:g}" for name in TABLE_4) + " |")
    print("| ratio, `aileron` | " + " | ".join(f"{ratio[name]:.2g}" for name in TABLE_4) + " |")
    shorter = []
    for name in TABLE_4:
        each = []
        for segment, sd in long["aileron-short", name].items():
            same = [s for s in long["aileron", name] if s.split(".")[0] == segment.split(".")[0]]
            nearest = min(same, key=lambda s: abs(speeds[s] - speeds[segment]))
            each.append(sd / long["aileron", name][nearest])
        shorter.append(f"{median(each):.2f} ({TABLE_4[name][1]})")
    print("| sd of 0.5 s over that of 1 s, same airspeeds (paper) | " + " | ".join(shorter) + " |")
    print(f"geometric mean of the ratios {math.exp(sum(map(math.log, ratio.values())) / len(ratio)):.2f}")


def median(values) -> float:
    values = sorted(values)
    n = len(values)
    return (values[(n - 1) // 2] + values[n // 2]) / 2


def validation(out: Path) -> None:
    print("| validation | maneuver | r.m.s. deg | largest deg | Theil | band deg | sd of the values deg | within | verdict |")
    print("|---|---|---|---|---|---|---|---|---|")
    for row in table(out, "validation").sort("segment", "validation").iter_rows(named=True):
        deg = [math.degrees(row[name]) for name in ("rms", "largest")]
        band = [math.degrees(row[name]) for name in ("band", "carried_sd")]
        print(f"| {row['validation']} | {row['segment']} | {deg[0]:.3f} | {deg[1]:.2f} | {row['theil']:.3f} | {band[0]:.3f} | {band[1]:.3f} | {100 * row['within']:.1f} % | {row['verdict']} |")


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "pipelines/citation/out")
    for heading, show in (("Lines", lines), ("Lines in one fit", one_fit), ("Friction", friction), ("Table 4", table_4), ("Validation", validation)):
        print(f"\n{heading}\n")
        show(folder)
