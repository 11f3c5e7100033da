"""The sealed effect of the demo: drawn by a seed, committed to by its hash, opened after the
verdict.
"""

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from cases import Setting, effect_params, visible_limit
from effects import BY_ID, FIRST, OUTSIDE_IDS, accepted
from profiles import Profile
from rigs import REFERENCE, generator_params
from signals import Sensors
from truth import TruthTool

# The board calibrates the offset of the current at rest, so that this effect would be invisible.
DEMO_IDS = tuple(name for name in FIRST if name != "current_offset")
# The rows of the board at 1 kHz: means of about eight samples with a noise of 0.15 A and a
# resolution of 0.125 A; Hall edges captured at 16 MHz.
BOARD = Sensors(
    current_noise_a=0.055,
    current_lsb_a=0.0125,
    supply_noise_v=0.02,
    supply_lsb_v=0.025,
    speed_lsb_rpm=0.5,
)
TOOL_NOISE = {"current_noise_a": 0.15, "supply_noise_v": 0.02, "hall_jitter_s": 2e-7}
# Trigger of the demo: (time, signed duty); zero is the released trigger, where the bridge opens.
# The magnitude only rises up to each release: where it falls with the bridge closed, the current
# crosses zero within the PWM ripple, and there the averaged dead time of the nominal model is not
# valid.
DEMO_STEPS = (
    (0.0, 0.0),
    (0.2, 0.08),
    (0.7, 0.16),
    (1.1, 0.3),
    (1.5, 0.5),
    (1.9, 0.75),
    (2.3, 1.0),
    (2.8, 0.0),
    (5.4, -0.1),
    (5.9, -0.25),
    (6.3, -0.45),
    (6.7, -0.7),
    (7.1, -1.0),
    (7.6, 0.0),
)
DEMO_SECONDS = 8.4
SIZES = (1.5, 8.0)
PREFIX = b"vgroove sealed truth 1\n"


@dataclass(frozen=True)
class Sealed:
    """A lock-step tool with a sealed effect; `commitment` is the SHA-256 of the answer in
    `path`.
    """

    tool: object
    commitment: str
    path: Path


def demo_setting(seed: int) -> Setting:
    """The demo's own run: a staircase with reversal on the 18 V reference rig."""
    rig = replace(REFERENCE, slew_per_s=6.0, sensors=BOARD)
    times, duty = (np.array(column) for column in zip(*DEMO_STEPS, strict=True))
    return Setting(rig, rig, Profile("demo", times, duty, coast_at_zero=True), DEMO_SECONDS, seed)


def kind_of_seed(seed: int, stream: int) -> int:
    """Kind 0..9 of a seed: of ten seeds in a row one has kind 0 (no effect) and one kind 1 (outside
    the catalogue); stream: which sequence of random numbers decides.
    """
    block, place = divmod(seed - 1, 10)
    return int(np.random.default_rng([block % 2**32, stream]).permutation(10)[place])


def draw_answer(seed: int) -> dict[str, object]:
    """Label, ids, accepted ids, size and tool parameters of a seed; of ten seeds in a row one has
    no effect and one is outside the catalogue.
    """
    kind = kind_of_seed(seed, 26)
    for attempt in range(20):
        rng = np.random.default_rng([seed, 19, attempt])
        setting = demo_setting(int(rng.integers(1, 2**31)))
        if kind == 0:
            return {
                "label": "none",
                "ids": [],
                "accept": [],
                "tool_seed": setting.seed,
                "params": {},
            }
        effect_id = str(rng.choice(OUTSIDE_IDS if kind == 1 else DEMO_IDS))
        sign = float(rng.choice([-1.0, 1.0])) if BY_ID[effect_id].signed else 1.0
        multiple = float(np.exp(rng.uniform(*np.log(SIZES))))
        limit = visible_limit(setting, effect_id, sign)
        if limit is not None and limit * multiple <= BY_ID[effect_id].top(setting.rig):
            return answer_of(setting, effect_id, sign * limit * multiple, multiple)
    raise RuntimeError(f"seed {seed}: no visible effect in 20 draws")


def answer_of(setting: Setting, effect_id: str, size: float, multiple: float) -> dict[str, object]:
    """The sealed answer for one effect."""
    params = {key: float(value) for key, value in effect_params(setting, effect_id, size).items()}
    found: dict[str, object] = {
        "label": "effect",
        "ids": [effect_id],
        "accept": [accepted(BY_ID[effect_id], two_way=True)],
    }
    if effect_id in OUTSIDE_IDS:
        found = {"label": "unlisted", "ids": [], "accept": [], "what": effect_id}
    return {
        **found,
        "size": size,
        "times_visible": multiple,
        "tool_seed": setting.seed,
        "params": params,
    }


def tool_of(answer: dict[str, object]) -> TruthTool:
    """The lock-step tool that an answer describes, with its sensors' noise."""
    seed = int(answer["tool_seed"])
    phase = float(np.random.default_rng([seed, 12]).uniform(0.1, 1.4))
    rig = replace(REFERENCE, sensors=BOARD)
    return TruthTool(
        **(
            generator_params(rig)
            | TOOL_NOISE
            | {"hall_offset_rad": phase, "seed": seed + 1}
            | dict(answer["params"])
        )
    )


def draw_sealed(seed: int, folder: Path) -> Sealed:
    """Draw the tool of a seed, and write the masked answer into `folder`."""
    answer = draw_answer(seed)
    return write_sealed(answer, tool_of(answer), folder)


def write_sealed(answer: dict[str, object], tool: object, folder: Path) -> Sealed:
    """Write the masked answer into `folder`; the tool that it describes, sealed."""
    text = json.dumps(answer, sort_keys=True).encode()
    text += b" " * (1024 - len(text) % 1024)  # so that the length does not reveal the answer
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "sealed_truth.bin"
    commitment = hashlib.sha256(text).hexdigest()
    path.write_bytes(PREFIX + mask(text, commitment))
    return Sealed(tool, commitment, path)


def open_sealed(path: Path, commitment: str) -> dict[str, object]:
    """The answer; ValueError where the file differs from the commitment."""
    data = path.read_bytes()
    if not data.startswith(PREFIX):
        raise ValueError(f"{path} is no sealed truth")
    text = mask(data[len(PREFIX) :], commitment)
    if hashlib.sha256(text).hexdigest() != commitment:
        raise ValueError(f"{path} is not what was committed to: {commitment}")
    return json.loads(text)


def mask(text: bytes, key: str) -> bytes:
    """The exclusive or of a text with a stream of hashes, which makes it unreadable; a second call
    restores the text.
    """
    blocks = (hashlib.sha256(f"{key} {n}".encode()).digest() for n in range(len(text) // 32 + 1))
    stream = b"".join(blocks)[: len(text)]
    return bytes(a ^ b for a, b in zip(text, stream, strict=True))
