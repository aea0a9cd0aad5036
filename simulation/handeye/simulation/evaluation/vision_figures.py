"""What trials of guided recognition amount to: figures beside targets and the thesis's, and histograms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handeye.simulation.evaluation import disturbing
from handeye.simulation.evaluation.outcome import Figure, average, share
from handeye.simulation.evaluation.site import Trial

BLUNDER = 50.0
"""px: a guess farther off than this must have been flagged."""


def figures(told: Sequence[Trial]) -> tuple[Figure, ...]:
    """The table of the evaluation, from the trials of all seeds."""
    looks = [each for each in told if each["what"] == "look"]
    ordinary = [each for each in looks if each["scene"] != "head turned"]
    turned = [each for each in looks if each["scene"] == "head turned"]
    absent = [each for each in told if each["what"] == "absent"]
    new = [each for each in told if each["what"] == "new cup"]
    guessed = [each for each in looks if "off_px" in each]
    blunders = [max(each["off_px"]) > BLUNDER and not each["flagged"] for each in guessed]
    found = [
        share(
            "vision-guided grasp (approach, grasp and lift)",
            [all(each["passed"].values()) for each in told if each["what"] == "grasp"],
            98.0,
            "approach 100 %, grasp 80 %",
        ),
        share(
            f"no guess more than {BLUNDER:g} px off unflagged", [not each for each in blunders], 100.0, "200 px, twice"
        ),
        share("ordinary looks not flagged", [not each["flagged"] for each in ordinary], 98.0),
        share("found in ordinary looks", [each["found"] for each in ordinary]),
        share("found with the head turned", [each["found"] for each in turned]),
        share("flagged with the head turned (hand)", [each["flagged"] for each in turned if each["thing"] == "hand"]),
        share("flagged where the cup is not there", [each["flagged"] for each in absent]),
        share("nothing taken for a cup that is not there", [not each["found"] for each in absent]),
        share("cups never seen before: found", [each["found"] for each in new]),
    ]
    for thing in ("object", "hand"):
        off = [each["off_px"] for each in ordinary if each["thing"] == thing and "off_px" in each]
        found.append(average(f"guess to find, {thing}", np.ravel(off), "px"))
        seen = np.array([each["truth_px"] for each in ordinary if each["thing"] == thing and each["found"]])
        # The silhouette's centre is not quite the cup's: a constant difference says nothing.
        scatter = np.abs(seen - seen.mean(axis=0)).max(axis=1)
        found.append(average(f"scatter of the find around the truth, {thing}", scatter, "px"))
        found += _times([each for each in looks if each["thing"] == thing and "whole_ms" in each], thing)
    return (*found, *_disturbances(told))


def _times(looks: Sequence[Trial], thing: str) -> list[Figure]:
    """Ratios of times within one look, and the ms themselves; one look is at two pictures."""
    trusted = [each for each in looks if not each["flagged"]]
    times = {
        key: np.array([each[key] for each in trusted])
        for key in ("search_whole_ms", "search_window_ms", "whole_ms", "window_ms", "guides_ms", "guided_ms")
    }
    whole, searched = times["whole_ms"], times["search_whole_ms"] / times["search_window_ms"]
    thesis = {"object": "164 / 37 s", "hand": "155 / 32 s"}[thing]
    return [
        average(f"detection alone, whole picture / window, {thing}", searched, "×", thesis=thesis, least=4.0),
        average(f"with alignment, whole picture / window, {thing}", whole / times["window_ms"], "×"),
        average(f"whole picture / guided with the guides' own time, {thing}", whole / times["guided_ms"], "×"),
        average(f"whole pictures, {thing}", whole, "ms"),
        average(f"windows, {thing}", times["window_ms"], "ms"),
        average(f"guides alone, {thing}", times["guides_ms"], "ms"),
        average(f"guided, {thing}", times["guided_ms"], "ms"),
    ]


def _disturbances(told: Sequence[Trial]) -> list[Figure]:
    """For each disturbance and level: object found right; and how often something else was taken for it."""
    spoilt = [each for each in told if each["what"] == "disturbed"]
    found = []
    for kind in disturbing.DISTURBANCES:
        for level in kind.levels:
            at = [each for each in spoilt if each["kind"] == kind.name and each["level"] == level]
            for thing in ("object", "hand") if at else ():
                right = [each[thing] == "right" for each in at]
                found.append(share(f"{thing} found under {kind.name} {level:g} {kind.unit}", right))
    return [
        *found,
        share("nothing wrong taken for the object, disturbed", [each["object"] != "wrong" for each in spoilt]),
    ]


def histograms(told: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    """How far guesses are from what is found there, in px, for object and hand."""
    looks = [each for each in told if each["what"] == "look" and "off_px" in each and each["scene"] != "head turned"]
    return {
        f"Guess to find in single pictures, {thing}, in px": tuple(
            float(off) for each in looks if each["thing"] == thing for off in each["off_px"]
        )
        for thing in ("object", "hand")
    }
