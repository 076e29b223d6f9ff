"""Is vibration found, and only where it is: `jitter_found.py [--seeds FIRST COUNT] [--curves-only] [--docs]`.

Jitter curves shake blocks without pixels: eight of one or two sines, and a real one. The real one is the difference of
the attitudes of a WorldView-3 camera over the Salar de Uyuni before and after another program's solution
(`jitter_solve` of the Ames Stereo Pipeline). Every block is adjusted with the defaults of the command line. Amplitudes
are compared with what residuals can show of the true curves: those, less what intersecting the rays of each point by
true cameras takes of them. Sound blocks are those of `clean_verdicts`, and the real blocks of HRSI_TEST_DATA.

Thresholds were tuned on seeds below 1000; judge on others.
"""

import argparse
import gzip
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from hrsi.benchmarks import clean_verdicts, real_blocks
from hrsi.benchmarks.pages import DOCS, put_between, render
from hrsi.hrsi_engine import AdjustOptions, adjust, judge
from hrsi.hrsi_engine.adjustment.jitter.spectrum import (
    WAVE_AXES,
    LineProfile,
    collect_line_profiles,
    find_block_waves,
)
from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.foundation.errors import HrsiError
from hrsi.hrsi_engine.foundation.thresholds import SIGNIFICANCE
from hrsi.hrsi_engine.laboratory.simulation import (
    SENSORS,
    BlockSimulation,
    Noise,
    OrientationError,
    PointCounts,
    SceneSpec,
    Vibration,
    make_along_track_views,
    simulate_block,
)
from hrsi.hrsi_engine.results.verdict.jitter import JITTER

PAGE = DOCS / "jitter.md"
UYUNI = real_blocks.DATA / "real" / "wv3_uyuni_jitter"
POSES = "csm-104001001427B900.r100.adjusted_state.json.gz"
UYUNI_PIXEL_RAD = 0.31 / 617e3
SIZE = (4000, 20000)
#: Amplitude (px) and period (lines) of the sines of each synthetic curve.
CURVES: dict[str, tuple[tuple[float, float], ...]] = {
    "0.3 px, 200 lines": ((0.3, 200.0),),
    "0.3 px, 1000 lines": ((0.3, 1000.0),),
    "0.3 px, 8000 lines": ((0.3, 8000.0),),
    "1 px, 200 lines": ((1.0, 200.0),),
    "1 px, 3000 lines": ((1.0, 3000.0),),
    "3 px, 500 lines": ((3.0, 500.0),),
    "3 px, 8000 lines": ((3.0, 8000.0),),
    "1 px, 5000 and 0.3 px, 350 lines": ((1.0, 5000.0), (0.3, 350.0)),
}
#: The real curve, as it is (0.06 px RMS) and enlarged.
UYUNI_CURVES = {"Salar de Uyuni": 1.0, "Salar de Uyuni, 10 times": 10.0}


def read_uyuni_curve(step: float = 10.0) -> np.ndarray:
    """Return line, across and along ``(n, 3)`` of the real curve in px, without the cubic that a correction follows.

    Attitudes of before and after give the rotation between them about the axes of the camera: one about its axis of
    flight moves the image across, one at right angles to flight and line of sight along. Positive is as the axes are.
    """
    before, after = (_read_state(UYUNI / name) for name in (POSES, f"jitter_solved_run-{POSES}"))
    seconds = before["m_intTimes"][0]
    line = np.arange(0.0, before["m_nLines"], step)
    time = before["m_intTimeStartTimes"][0] + seconds * line
    turns = []
    for state in (before, after):
        quaternions = np.array(state["m_quaternions"]).reshape(-1, 4)
        times = state["m_t0Quat"] + state["m_dtQuat"] * np.arange(len(quaternions))
        turns.append(Slerp(times, Rotation.from_quat(quaternions))(np.clip(time, times[0], times[-1])))
    angle = (turns[0].inv() * turns[1]).as_rotvec()
    velocity = np.array(before["m_velocities"]).reshape(-1, 3).mean(axis=0)
    flight = turns[0].inv().apply(velocity).mean(axis=0) * [1.0, 1.0, 0.0]
    flight /= np.linalg.norm(flight)
    side = np.cross([0.0, 0.0, 1.0], flight)
    moved = np.column_stack([angle @ flight, angle @ side]) / UYUNI_PIXEL_RAD
    u = 2.0 * line / line[-1] - 1.0
    cubic = np.vander(u, 4)
    return np.column_stack([line, moved - cubic @ np.linalg.lstsq(cubic, moved, rcond=None)[0]])


def _read_state(path: Path) -> dict:
    text = gzip.decompress(path.read_bytes()).decode("utf-8")
    return json.loads(text[text.index("{") :])


def make_vibrations(curve: str, images: int, seed: int) -> list[Vibration]:
    """Return the vibration of each image, with random phases."""
    rng, pixel_rad = np.random.default_rng([seed, 71]), SENSORS["pleiades"].detector_angle_rad
    if curve in CURVES:
        return [
            Vibration(waves=tuple((p, a * pixel_rad, float(rng.uniform(0.0, 6.283))) for a, p in CURVES[curve]))
            for _ in range(images)
        ]
    table = read_uyuni_curve()
    table[:, 1:] *= -pixel_rad * UYUNI_CURVES[curve]
    rows = tuple((line, roll, pitch) for line, roll, pitch in table.tolist())
    starts = rng.uniform(SIZE[1] / 2.0, table[-1, 0] - SIZE[1] / 2.0, images)
    return [Vibration(curve=rows, start_line=float(start)) for start in starts]


def simulate_shaken(curve: str, images: int, seed: int) -> BlockSimulation:
    """Return a block with a jitter curve: 80 GCPs for one image, else 8 GCPs and 1500 tie points."""
    vibrations = make_vibrations(curve, images, seed)
    views = [
        replace(view, jitter=OrientationError(vibration=vibration))
        for view, vibration in zip(make_along_track_views(SENSORS["pleiades"], images, SIZE), vibrations, strict=True)
    ]
    counts = PointCounts(80 if images == 1 else 8, 20, 0 if images == 1 else 1500)
    scene = SceneSpec(10.0, 45.0, 300.0, relief_m=200.0, seed=seed)
    return simulate_block(scene, views, counts, Noise(0.2))


def compute_visible(simulated: BlockSimulation, result: Adjustment, profiles: Sequence[LineProfile]) -> list:
    """Return what residuals can show of the true curves: ``(n, 2)`` px of each profile's measurements.

    Each point takes the displacements e of its rays as an intersection does, ``v = e - B (B' P B)^-1 B' P e``; of a GCP
    nothing; the profile has v over its redundancy number.
    """
    block, truth = result.block, simulated.truth
    rows = block.measurements
    index = {name: number for number, name in enumerate(truth.ids.tolist())}
    ground = truth.ground[[index[name] for name in block.points.ids.tolist()]]
    moved, by_ground = np.zeros((len(rows), 2)), np.zeros((len(rows), 2, 3))
    for number, image in enumerate(block.images):
        here = np.flatnonzero(rows.image == number)
        camera, steady = truth.cameras[number], replace(truth.cameras[number], error=OrientationError())
        moved[here] = camera.ground_to_image(ground[rows.point[here]]) - steady.ground_to_image(
            ground[rows.point[here]]
        )
        by_ground[here] = image.rpc.project_with_metric_jacobian(ground[rows.point[here]])[1]
    left = moved.copy()
    for point in np.flatnonzero(~block.known):
        here = np.flatnonzero(rows.point == point)
        design = by_ground[here].reshape(-1, 3)
        weight = np.repeat(result.sigma_px[here] ** -2.0, 2)
        normal = design.T @ (weight[:, None] * design)
        left[here] -= (design @ np.linalg.solve(normal, design.T @ (weight * moved[here].ravel()))).reshape(-1, 2)
    used = (result.decision == 0) & (result.weight > 0.0)
    shown = []
    for profile in profiles:
        here = np.flatnonzero(used & (rows.image == profile.image))
        keys = {(line, sample): row for row, line, sample in zip(here, rows.xy[here, 1], rows.xy[here, 0], strict=True)}
        own = [keys[key] for key in zip(profile.line, profile.sample, strict=True)]
        # A GCP's misclosure is shared by its image point and its survey, by the redundancy number
        share = np.where(block.known[rows.point[own], None], 1.0, result.redundancy_numbers[own])
        shown.append(left[own] / share)
    return shown


def fit_amplitude(profile: LineProfile, shift: np.ndarray, axis: str, period: float) -> float:
    """Return the amplitude of a sine in displacements ``(n, 2)`` of a profile, beside a cubic of line and sample."""
    column = WAVE_AXES.index(axis)
    used = profile.weight[:, column] > 0.0
    u, v, angle = profile.line[used] / SIZE[1], profile.sample[used] / SIZE[0], 2 * np.pi * profile.line[used] / period
    design = np.column_stack([u**0, u, u**2, u**3, v, v * u, v * u**2, np.cos(angle), np.sin(angle)])
    root = np.sqrt(profile.weight[used, column])
    solved = np.linalg.lstsq(design * root[:, None], shift[used, column] * root, rcond=None)[0]
    return float(np.hypot(*solved[-2:]))


def curve_rows(seeds: Sequence[int]) -> list[list[str]]:
    """Return a row a curve and number of images: in how many blocks it was found, and how well."""
    rows = []
    for curve in (*CURVES, *UYUNI_CURVES):
        for images in (1, 2, 3):
            found, named, periods, amplitudes, seen = 0, 0, list[float](), list[float](), list[float]()
            for seed in seeds:
                simulated = simulate_shaken(curve, images, seed)
                result = adjust(simulated.block, AdjustOptions())
                profiles = collect_line_profiles(result)
                waves = find_block_waves(profiles)
                shown = compute_visible(simulated, result, profiles)
                strongest = max(
                    ((wave, k) for k, own in enumerate(waves) for wave in own),
                    key=lambda one: one[0].amplitude_px, default=None,
                )  # fmt: skip
                found += strongest is not None
                named += any(reason.code == "jitter" for reason in judge(result).reasons)
                largest = max(
                    fit_amplitude(profile, shift, axis, period)
                    for profile, shift in zip(profiles, shown, strict=True)
                    for axis in WAVE_AXES if (profile.weight[:, WAVE_AXES.index(axis)] > 0.0).sum() > 50
                    for period in ([p for _, p in CURVES[curve]] if curve in CURVES else
                                   [strongest[0].period_lines] if strongest else [1000.0])
                )  # fmt: skip
                seen.append(largest)
                if strongest is not None:
                    wave, k = strongest
                    truth = fit_amplitude(profiles[k], shown[k], wave.axis, wave.period_lines)
                    amplitudes.append(abs(wave.amplitude_px - truth))
                    if curve in CURVES:
                        periods.append(min(abs(wave.period_lines / p - 1.0) for _, p in CURVES[curve]))
            row = [curve, str(images), f"{np.median(seen):.2f}", f"{found} of {len(seeds)}", f"{named} of {len(seeds)}",
                   f"{100 * np.median(periods):.1f} %" if periods else "-",
                   f"{np.median(amplitudes):.2f}" if amplitudes else "-"]  # fmt: skip
            print(row, flush=True)
            rows.append(row)
    return rows


def sound_waves(first: int, count: int) -> Iterator[tuple[str, float]]:
    """Yield the sensor and the largest amplitude found, 0 without any, of every sound block."""
    for seed in range(first, first + count):
        for sensor in SENSORS:
            block, _ = clean_verdicts.simulated(sensor, seed)
            try:
                result = adjust(block, AdjustOptions(model=clean_verdicts.MODELS_JUDGED[seed % 2]))
            except HrsiError:  # too few points for this model
                continue
            waves = [wave for own in find_block_waves(collect_line_profiles(result)) for wave in own]
            for wave in waves:
                print(f"{sensor} {seed}: {wave}", flush=True)
            yield sensor, max((wave.amplitude_px for wave in waves), default=0.0)


def real_rows() -> list[list[str]]:
    """Return the waves of the real blocks."""
    rows = []
    for name, make in clean_verdicts.REAL.items():
        result = adjust(make(), AdjustOptions())
        profiles = collect_line_profiles(result)
        waves = [wave for own in find_block_waves(profiles) for wave in own]
        most = max((len(profile.line) for profile in profiles), default=0)
        told = "; ".join(f"{w.amplitude_px:.2f} px, {w.period_lines:.0f} lines, {w.axis}" for w in waves) or "none"
        named = "yes" if any(wave.amplitude_px >= JITTER.reported_px for wave in waves) else "no"
        rows.append([name, str(most), told, named])
        print(rows[-1], flush=True)
    return rows


def main(words: Sequence[str] | None = None) -> None:
    """Print the tables; ``--docs`` writes the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=(2000, 67), metavar=("FIRST", "COUNT"))
    parser.add_argument("--blocks", type=int, default=4, metavar="N", help="blocks of each curve and number of images")
    parser.add_argument("--part", choices=("curves", "blocks", "real"), help="only this part")
    parser.add_argument("--curve", metavar="FILE", help="write the curve of the Salar de Uyuni as CSV, and end")
    parser.add_argument("--docs", action="store_true", help=f"write into {PAGE.name}")
    options = parser.parse_args(words)
    if options.curve:
        lines = [f"{line:g},{across:.5f},{along:.5f}\n" for line, across, along in read_uyuni_curve().tolist()]
        Path(options.curve).write_text("line,across,along\n" + "".join(lines), encoding="utf-8")
        return
    first, count = options.seeds
    parts = {}
    if options.part in (None, "curves"):
        head = ("curve", "images", "visible px", "found", "reason", "period off", "amplitude off px")
        parts["curves"] = render(head, curve_rows(range(first, first + options.blocks)))
    if options.part in (None, "blocks"):
        sound = list(sound_waves(first, count))
        named = sum(amplitude >= JITTER.reported_px for _, amplitude in sound)
        waves = sum(amplitude > 0.0 for _, amplitude in sound)
        parts["blocks"] = (
            f"Of {len(sound)} correct blocks {waves} have a significant wave, and {named} the reason `jitter`. "
            f"{SIGNIFICANCE.false_alarm * len(sound):.2f} are expected by chance.\n"
        )
    if options.part in (None, "real"):
        parts["real"] = render(("block", "most points in an image", "waves", "reason"), real_rows())
    print("\n".join(parts.values()))
    if options.docs:
        for name, made in parts.items():
            put_between(PAGE, name, made.strip())


if __name__ == "__main__":
    main()
