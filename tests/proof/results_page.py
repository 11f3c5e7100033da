"""Writes docs/results.md, every measured figure of the project, from docs/results/*.json:
`python tests/proof/results_page.py` writes the page; `--check` exits with 1 where it differs.
"""

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "docs" / "results"
PAGE = ROOT / "docs" / "results.md"

HEAD = """\
# Results

Generated from the JSON files of [results](results/) by `python tests/proof/results_page.py`; a test
fails when the page differs from them. A result of `make proof` carries the commit that it was made
at; the figures of the last table are printed by the commands beside them.

Terms: *sealed* (hidden from the diagnosis until its verdict), *visible* (the visible limit), rig
*exact* or *off* and *engine* are defined in [gap_bench](gap_bench.md); *in reach*, *cell* and the
measures of the controllers in [control_bench](control_bench.md); *clean blow* in
[studies](studies.md); the roll-outs and solvers of the speed table in [plant](plant.md).
"""

# Groups of cases of the blind set: key of the JSON -> words.
GROUPS = {
    "single": "one effect",
    "pair": "two effects",
    "triple": "three effects",
    "none": "no effect",
    "unlisted": "outside the catalogue",
}
OVERALL = {
    "false_alarms": "an effect named where there is none",
    "sure_and_wrong": "wrong name with a probability of 0.9 or more",
    "ambiguous_though_separable": "`ambiguous` although one name would do",
    "failed": "no verdict",
}


# regime `measured`: key of a rate -> words, goal
MEASURED = {
    "single": ("one effect, named first", "85 %"),
    "pair_both_named": ("two effects, both named", "65 %"),
    "disturbances_named": ("disturbances alone, an effect named", "at most 10 %"),
    "sure_and_wrong": ("wrong name with a probability of 0.9 or more", "at most 2 %"),
}


def read(name: str) -> dict[str, Any]:
    """One result by the name of its file."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def table(header: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> list[str]:
    """Lines of a Markdown table."""
    lines = [header, ("---",) * len(header), *rows]
    return ["| " + " | ".join(str(cell) for cell in line) + " |" for line in lines]


def rate(of: dict[str, Any]) -> str:
    """Hits of a rate with the 95 % interval of its share."""
    low, high = of["ci95"]
    return f"{of['hits']} of {of['of']} ({100 * low:.0f}..{100 * high:.0f} %)" if of["of"] else "-"


# Half of the blind set -> what it has been used for.
HALVES = {
    "report": "Used for reporting only: no threshold is chosen on it.",
    "tune": "Thresholds are chosen on this half.",
}


def blind_set(name: str) -> list[str]:
    """Rates of one half of the blind set."""
    result = read(name)
    rates = result["rates"]
    return [
        f"## Blind set of the diagnosis, half `{result['set']}`",
        "",
        f"{result['cases']} sealed cases of the independent generator ([gap_bench](gap_bench.md)),"
        f" engine {result['engine']}.",
        HALVES[result["set"]] + " Right verdicts, with 95 % intervals:",
        "",
        *table(
            (
                "cases",
                "rig exact, 3 times visible and more",
                "rig off, other forms, from 1.5 times",
            ),
            (
                (words, rate(rates["exact"][key]), rate(rates["hard"][key]))
                for key, words in GROUPS.items()
            ),
        ),
        "",
        *table(
            ("over all cases", ""), ((words, rate(rates[key])) for key, words in OVERALL.items())
        ),
    ]


def measured_cases(result: dict[str, Any]) -> list[str]:
    """Which cases of the regime `measured` a result holds, and the command that gives it: those of
    consecutive numbers where it states the first and the last one, else the first ones.
    """
    command, ends = f"`vgroove gap bench --set {result['set']}", result.get("numbers")
    if ends is None:
        return [
            f"The first {result['cases']} cases with disturbances ([gap_bench](gap_bench.md)),",
            f"engine {result['engine']}:",
            f"{command} --regime measured --count {result['cases']}`.",
        ]
    return [
        f"The cases {ends[0]} to {ends[1]} with disturbances ([gap_bench](gap_bench.md)),",
        f"engine {result['engine']}:",
        f"{command} --number {ends[0]} ... --number {ends[1]}`.",
    ]


def hammering_tool(name: str) -> list[str]:
    """Right verdicts on the blind set of the hammering tool."""
    result = read(name)
    rates = result["rates"]
    kinds = [
        (words, *(rate(rates[regime][kind]) for regime in ("exact", "loose")))
        for kind, words in GROUPS.items()
        if any(rates[regime][kind]["of"] for regime in ("exact", "loose"))
    ]
    rows = [(words, rate(rates[key]), goal) for key, (words, goal) in HAMMERING.items()]
    closed = result["closed"]["closed"]["median"]
    text = f"{closed:.2f}" if closed else "-"
    rows.append(("gap closed by right verdicts, median", text, "0.9"))
    cost = seconds_text(result["cost"]["cpu_seconds"])
    rows.append(("processor time of a diagnosis, median and maximum, s", cost, ""))
    return [
        "## Blind set of the diagnosis, hammering tool, half `report`",
        "",
        f"The first {result['cases']} cases in their random order ([gap_bench](gap_bench.md)),",
        f"engine {result['engine']}; right verdicts, with 95 % intervals, of",
        f"`vgroove gap bench --impact --set report --count {result['cases']}`:",
        "",
        *table(("cases", "exact rig", "joint or tool uncertain"), kinds),
        "",
        *table(("over all kinds", "", "goal"), rows),
        "",
    ]


# Rate over all cases of the hammering tool -> what it is, and its goal.
HAMMERING = {
    "exact_drive_signals": ("right, exact rig, drive signals alone", "85 %"),
    "exact_bench_channels": ("right, exact rig, with channels of a test bench", "92 %"),
    "loose_all": ("right, joint or tool uncertain", "75 %"),
    "sure_and_wrong": ("wrong name with a probability of 0.9 or more", "1 %"),
    "false_alarms": ("an effect named where there is none", "2 %"),
    "failed": ("no verdict", "0"),
}


def seconds_text(cost: dict[str, float]) -> str:
    """Median and maximum of a cost."""
    return f"{cost['median']:.0f}, {cost['max']:.0f}"


def measured_regime(name: str) -> list[str]:
    """Rates and calibration of the regime `measured`."""
    result = read(name)
    rates = result["rates"]["measured"]
    part = ", further cases" if "numbers" in result else ""
    return [
        f"## Blind set of the diagnosis, regime `measured`, half `{result['set']}`{part}",
        "",
        *measured_cases(result),
        "",
        *table(
            ("cases", "95 % interval", "goal"),
            ((words, rate(rates[key]), goal) for key, (words, goal) in MEASURED.items()),
        ),
        "",
        *table(
            ("probability that the verdict gives", "mean", "true names"),
            (
                (f"{row['from']:.2f} .. {row['to']:.2f}", f"{row['said']:.2f}", rate(row))
                for row in result["calibration_by_regime"]["measured"]
                if row["of"]
            ),
        ),
    ]


def demo(name: str, command: str) -> list[str]:
    """The sealed tools of a kind of demo: `command`, the file of its results."""
    result = read(name)
    rows = (
        (
            run["seed"],
            ", ".join(run["truth"]) or run["label"],
            run["verdict"],
            ", ".join(run["selected"]) or "-",
            f"{run['before']:.2f}",
            f"{run['after']:.2f}",
        )
        for run in result["runs"]
    )
    return [
        f"`{command} SEED=n`: {result['right']} of {result['of']} verdicts are right, commit "
        f"{result['commit']}.",
        "",
        *table(("seed", "sealed effect", "verdict", "named", "gap before", "after"), rows),
    ]


def demos() -> list[str]:
    """The sealed tools of `make demo`, hammering and drivetrain alone."""
    return [
        "## Sealed tools of the demo",
        "",
        *demo("demo_seeds_impact", "make demo"),
        *demo("demo_seeds", "make demo TOOL=drive"),
    ]


def firmware(name: str) -> list[str]:
    """Firmware gaps, plant gaps and logs without a gap that the replay tells rightly."""
    result = read(name)
    words = {
        "firmware_told_from_plant": "firmware gap or none, of all cases",
        "kind_right": "kind right, of all cases",
        "kind_right_of_firmware_gaps": "kind right, of the firmware gaps",
        "tick_exact": "first tick exact, of the firmware gaps",
        "parameter_named": "parameter named, of the parameter gaps",
        "value_within_range": "its value within the range found",
        "called_firmware_without_one": "called a firmware gap without one",
        "plant_gaps_called_firmware": "plant gaps called a firmware gap",
    }
    return [
        f"## Firmware in the loop, half `{result['set']}`",
        "",
        f"Commit {result['commit']}; right answers, with 95 % intervals, of",
        f"`{result['command']}`",
        "on the cases of `python tests/firmware_gap/firmware_bench.py make FOLDER` for that half:",
        "",
        *table(("cases", "share"), [(text, rate(result[key])) for key, text in words.items()]),
    ]


def real_time() -> list[str]:
    """Tables of the runs of `vgroove hil` with a simulated board in real time, of the telemetry
    frames received in 10 minutes, and of the serial buses.
    """
    result = read("hil")
    rows = (
        (
            name.replace("_", " "),
            run["ticks"],
            run["frames_damaged"],
            run["sent_again"],
            f"{run['jitter_ms']['median']:.3f}, {run['jitter_ms']['99 %']:.2f}, "
            f"{run['jitter_ms']['99.9 %']:.2f}, {run['jitter_ms']['worst']:.1f}",
            f"{run['latency_ticks']['median']:g}, {run['latency_ticks']['99 %']:g}, "
            f"{run['latency_ticks']['99.9 %']:g}, {run['latency_ticks']['worst']:g}",
            run["late_steps"],
            run["late_steps_without_pause_of_computer"],
            f"{run['pauses_of_computer']['count']}, {run['pauses_of_computer']['worst_ms']:.1f} ms",
            run["bridge_opened"],
            run["machine"]["before"]["load_1min"],
        )
        for name, run in result["runs"].items()
    )
    header = (
        "run",
        "ticks of 1 ms",
        "frames damaged",
        "sent again",
        "jitter / ms: median, 99 %, 99.9 %, worst",
        "latency / ticks: median, 99 %, 99.9 %, worst",
        "late steps",
        "late without a pause of the computer",
        "pauses of the computer, longest",
        "bridge opened",
        "load before",
    )
    return [
        "## Hardware in the loop in real time",
        "",
        f"`{result['command']}`, commit {result['commit']}; 60 s each,",
        "simulated board behind a pseudo-terminal on the same two processors.",
        "",
        *table(header, rows),
        "",
        *streams(),
        "",
        *serial_readers(),
    ]


def streams() -> list[str]:
    """Table of the telemetry frames received in 10 minutes while each processor is also busy with
    another process.
    """
    result = read("streams")
    rows = (
        (
            name,
            run["frames_sent"],
            run["lost"],
            f"{run['machine']['before']['load_1min']}, {run['machine']['after']['load_1min']}",
        )
        for name, run in result["streams"].items()
    )
    return [
        f"`{result['command']}`, commit {result['commit']}; 10 minutes each,",
        "beside a busy process for each processor.",
        "",
        *table(("stream", "frames sent", "frames lost", "load before, after"), rows),
    ]


def serial_readers() -> list[str]:
    """Table of frames received and processor time per frame: python-can's serial bus and this
    project's.
    """
    result = read("serial_readers")
    rows = (
        (stream, reader, row["frames_sent"], row["frames_received"], row["us_of_processor_each"])
        for stream, readers in result["readers"].items()
        for reader, row in readers.items()
    )
    header = ("stream", "bus", "frames sent", "received", "processor time a frame / us")
    return [
        f"`{result['command']}`, commit {result['commit']}; {result['seconds']:g} s each beside",
        "a busy process for each processor, taken message by message with `recv`: python-can's",
        "serial bus and this project's.",
        "",
        *table(header, rows),
    ]


def plausibility() -> list[str]:
    """Table of the drawn runs with a wrong current sensor: in how many the telemetry names it, and
    after what time the drive ends.
    """
    result = read("plausibility")
    rows = (
        (
            name.replace("_", " "),
            run["runs"],
            run["named_in_drive_or_after"],
            run["ended"],
            run["median_ms"],
            run["worst_ms"],
        )
        for name, run in result.items()
        if "named_in_drive_or_after" in run
    )
    header = ("fault", "runs", "named", "ended the drive", "median / ms", "worst / ms")
    sound = result["without_fault"]
    return [
        "## Current sensor: false trips and detection",
        "",
        f"`{result['command']}`, commit {result['commit']}: drawn runs of every controller with a",
        "drawn tool. Without a fault, with moves and further pulls of the trigger, both release",
        "modes, drawn noise of the sensors and a third of the runs without noise:",
        f"{sound['false_trips']} of {sound['runs']} name `sensor_lost`. A fault begins in the",
        "drive; what it does not end is named after the release:",
        "",
        *table(header, rows),
    ]


def diagnosed_tools() -> list[str]:
    """Torque control of tools that were diagnosed and adapted, on the independent simulator."""
    result = read("diagnosed_tools")
    names = {"reference tool": "reference tool", "corrected rig": "corrected rig"}
    names |= {"true values": "true values of the tool"}
    rows = (
        (
            words,
            f"{of['runs']}; {of['reached']}",
            f"{100 * of['mean_error']:+.1f} %; {100 * of['std']:.1f} %",
            f"{100 * of['quantile_low']:+.1f} %; {100 * of['quantile_high']:+.1f} %",
            f"{100 * of['worst']:+.1f} %",
            of["beyond_goal"],
            of["missed_reported_reached"],
        )
        for name, words in names.items()
        for of in (result["all"][name],)
    )
    header = (
        "firmware of the",
        "drives; reported as reached",
        "mean error; standard deviation",
        "5 % quantile; 95 % quantile",
        "worst",
        "off by more than 3 %",
        "off by more than 1/16, reported as reached",
    )
    tools = result["tools"]
    verdicts = ", ".join(tool["diagnosis"]["verdict"] for tool in tools)
    worst = max(
        (abs(tool["drives"]["corrected rig"]["mean_error"]), tool["tool"]) for tool in tools
    )
    return [
        "## From a diagnosis to an adapted tool",
        "",
        f"`{result['command']}`, commit {result['commit']}: {len(tools)} drawn tools of the",
        "independent simulator, up to 5 % off in nine values and with friction in the grooves; two",
        "recorded runs each, diagnosed with the rig of the reference tool, adapted with the",
        f"corrected rig, and driven to drawn torques ({result['drives_of_a_tool']} drives each;",
        "[torque control](controllers/torque.md)).",
        f"Verdicts: {verdicts}. Largest mean error of a tool with its corrected rig:",
        f"{100 * worst[0]:.1f} %.",
        "",
        *table(header, rows),
    ]


def soak() -> list[str]:
    """Table of ten simulated hours of the ELF files, compared with the native firmware."""
    result = read("soak")
    rows = (
        ("simulated hours", f"{result['hours']:.1f}"),
        ("pieces of a minute", result["pieces"]),
        ("of them across 2^32 ms", result["passing_2_32_ms"]),
        ("share of time driven", f"{result['driven_share']:.2f}"),
        ("least stack never used / bytes", result["least_stack_free_bytes"]),
        ("findings", len(result["findings"])),
    )
    return [
        "## Ten hours of the ELF against the native firmware",
        "",
        f"`{result['command']}`, commit {result['commit']}; a finding is a difference, a gap in",
        "the telemetry, a reset, or a stack that was used up ([bench](bench.md)).",
        "",
        *table(("", "value"), rows),
        *([""] if result["findings"] else []),
        *(f"- {text}" for text in result["findings"]),
    ]


def growth() -> list[str]:
    """Exponents of the diagnosis' processor time."""
    result = read("gap_growth")
    return [
        "## Processor time of a diagnosis",
        "",
        "Exponent of the growth (1 is linear), commit " + result["commit"] + ":",
        "",
        *table(
            ("with", "exponent"),
            (
                ("length of the log, 3 to 24 s", f"{result['with_length']:.2f}"),
                ("number of effects, 8 to 30", f"{result['with_effects']:.2f}"),
            ),
        ),
    ]


def speed() -> list[str]:
    """The plant beside its peers."""
    result = read("bench_speed")
    return [
        "## Speed of the plant",
        "",
        f"`{result['command']}`, commit {result['commit']}, {result['cpu']}, {result['cores']}"
        " cores:",
        "",
        *table(
            ("figure", "value", "required"),
            (
                (row["name"], f"{row['value']:.3g}", f"{row['relation']} {row['asked']:g}")
                for row in result["asked"]
            ),
        ),
    ]


def trap() -> list[str]:
    """Errors of identification methods on a joint whose model lacks its Coulomb friction."""
    result = read("bench_trap")
    return [
        "## A joint whose model lacks its Coulomb friction",
        "",
        "`vgroove bench trap`: one log for all methods; the error of the speed is on other data.",
        "",
        *table(
            ("method", "error of the damping", "error of the speed"),
            (
                (
                    row["name"],
                    percent(row.get("damping_error"), "+.1f"),
                    percent(row.get("speed_error"), ".2f"),
                )
                for row in result["answers"]
            ),
        ),
    ]


def percent(value: float | None, form: str) -> str:
    """A share in per cent, a dash where there is none."""
    return "-" if value is None else f"{100 * value:{form}} %"


def torque() -> list[str]:
    """Torque control on many joints."""
    result = read("control_torque")
    return [
        "## Torque control, 200 joints a cell",
        "",
        f"`{result['command']}`, commit {result['commit']}:",
        "",
        *table(
            ("variant", "set", "goal", "value", "limit"),
            (
                (
                    row["variant"],
                    row["set"],
                    row["goal"],
                    f"{row['value']:.3g}",
                    f"{row['side']} {row['limit']:g}",
                )
                for row in result["goals"]
            ),
        ),
    ]


# Part with drawn values -> title, columns: (title, key, form). A share has the form "%", a count
# none, another number its format.
DRAWN = {
    "control_blows_drawn": (
        "Blow count between chosen values",
        [
            ("tool", "stratum", ""),
            ("source", "variant", ""),
            ("cells", "cells", ""),
            ("off by more than 1 % and a blow", "failures", ""),
            ("error, mean", "error", "%"),
            ("95 % quantile", "error_tail", "%"),
            ("worst", "worst", "%"),
            ("repeats: precision", "precision", "%"),
            ("recall", "recall", "%"),
        ],
        ("failures_low", "failures_high"),
    ),
    "control_sync_drawn": (
        "Synchronisation between chosen values, from 2.5 s on",
        [
            ("tool", "stratum", ""),
            ("variant", "variant", ""),
            ("cells", "cells", ""),
            ("clean, mean", "steady_clean", "%"),
            ("5 % quantile", "steady_clean_tail", "%"),
            ("worst", "steady_clean_worst", "%"),
            ("worse than without", "steady_worse", ""),
            ("out of step", "steady_out_of_step", ""),
        ],
        ("steady_out_low", "steady_out_high"),
    ),
    "control_screwing_drawn": (
        "Precise screwing between chosen values",
        [
            ("tool", "stratum", ""),
            ("variant", "variant", ""),
            ("screws", "screws", ""),
            ("impact rate change, small and soft", "rate_change_soft", "%"),
            ("past the seat in deg, median", "past_deg_median", ".0f"),
            ("time with / without, mean", "time_ratio", ".2f"),
            ("slowest group", "time_group", ".2f"),
            ("past the ramp", "stripped", ""),
            ("not seated in 45 s", "never", ""),
            ("stopped before the seat", "early", ""),
        ],
        ("early_low", "early_high"),
    ),
    "control_vibration_drawn": (
        "Low vibration between chosen values",
        [
            ("tool", "stratum", ""),
            ("variant", "variant", ""),
            ("cells", "cells", ""),
            ("RMS change, mean", "change", "%"),
            ("95 % quantile", "change_tail", "%"),
            ("worst", "worst", "%"),
            ("mean from 16 V on", "full_change", "%"),
            ("mean from 0.15 s after the first blow on", "late", "%"),
            ("time", "time", "%"),
            ("joint not turned", "without_aim", ""),
            ("above +5 % or aim missed", "above", ""),
        ],
        ("above_low", "above_high"),
    ),
    "control_torque_drawn": (
        "Torque control between chosen values",
        [
            ("tool", "variant", ""),
            ("drives reported as reached", "reached", ""),
            ("mean error", "mean_error", "%"),
            ("standard deviation", "std", "%"),
            ("worst", "worst", "%"),
            ("off by more than 3 %", "beyond_goal", ""),
            ("targets met of 81", "targets_met", ""),
            ("never reached", "targets_not_reached", ""),
            ("reached once", "targets_reached_once", ""),
            ("misses reported as reached", "missed_reported_reached", ""),
        ],
        ("missed_reported_reached_low", "missed_reported_reached_high"),
    ),
}


def in_form(value: float, form: str) -> str | float:
    """A figure in the form of its column in DRAWN."""
    if form == "%":
        return percent(value, ".1f")
    return format(value, form) if form else value


def drawn(name: str) -> list[str]:
    """The half `report` of a part of the controllers' bench whose values are drawn; the interval is
    that of the last count.
    """
    title, columns, (low, high) = DRAWN[name]
    result = read(name)
    rows = [row for row in result["summary"] if row["set"] == "report"]
    return [
        f"## {title}",
        "",
        f"Half `report`; `{result['command']}`, commit {result['commit']}:",
        "",
        *table(
            (*(column[0] for column in columns), "share, 95 % interval"),
            (
                (
                    *(in_form(row[key], form) for _, key, form in columns),
                    f"{100 * row[low]:.1f}..{100 * row[high]:.1f} %",
                )
                for row in rows
            ),
        ),
    ]


def printed() -> list[str]:
    """Figures that commands print."""
    rows = [row for row in read("figures").values() if isinstance(row, dict)]
    return [
        "## Firmware, controllers, data",
        "",
        *table(
            ("figure", "value", "command"),
            ((row["figure"], row["value"], f"`{row['command']}`") for row in rows),
        ),
    ]


def page() -> str:
    """The text of docs/results.md."""
    parts = (
        demos(),
        blind_set("gap_bench"),
        blind_set("gap_bench_tune"),
        measured_regime("gap_bench_measured_further"),
        measured_regime("gap_bench_measured"),
        hammering_tool("gap_bench_impact"),
        firmware("gap_bench_firmware"),
        firmware("gap_bench_firmware_tune"),
        growth(),
        real_time(),
        plausibility(),
        soak(),
        speed(),
        trap(),
        *(drawn(name) for name in DRAWN),
        torque(),
        diagnosed_tools(),
        printed(),
    )
    return HEAD + "".join("\n" + "\n".join(lines) + "\n" for lines in parts)


def main() -> None:
    """Write the page, or with --check exit with 1 where it is not up to date."""
    if "--check" in sys.argv:
        raise SystemExit(PAGE.read_text(encoding="utf-8") != page())
    PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
