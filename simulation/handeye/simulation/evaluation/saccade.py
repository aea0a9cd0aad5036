"""SCS as in the thesis's Fig 4.17: 45 samples; the head moves, then how far off the middle the ball is seen."""

from __future__ import annotations

from typing import Any

import numpy as np

from handeye.simulation.collecting import FIXATIONS, collect
from handeye.simulation.evaluation.outcome import Outcome, average, share
from handeye.simulation.evaluation.site import Site
from handeye.simulation.report import Picture

TITLE = "Gaze (SCS): saccades to a ball from anywhere"

_THESIS = "10.6 px"


def evaluate(site: Site, seed: int, trials: int) -> Outcome:
    """Collects 45 samples by fixating, then looks at balls elsewhere from other poses of the head."""
    experimenter, client = site.experimenter, site.client
    collect("SCS", site.lab, client, seed, site.progress)
    told: list[dict[str, Any]] = []
    pictures: list[Picture] = []
    with site.progress("saccades", trials) as advance:
        for pan, tilt, place in experimenter.balls(seed + 1):
            if not experimenter.present(pan, tilt, place):
                continue
            job = client.gaze("ball")
            looks = job.result.looks if job.result is not None else ()
            if not looks:  # the arm is before it
                continue
            offsets = [look.offset for look in looks]
            told.append({"pan": pan, "tilt": tilt, "place": place.tolist(), "offsets": offsets, "state": job.state})
            if len(told) <= 2:
                pictures.append(Picture(client.frame("left"), f"Trial {len(told)}: the left picture at the end."))
            advance()
            if len(told) == trials:
                break
    first = [after(each["offsets"], 1) for each in told]
    third = [after(each["offsets"], 3) for each in told]
    return Outcome(
        "scs",
        TITLE,
        (seed, seed + 1),
        (
            average(f"mean offset after one saccade, {FIXATIONS} samples", first, "px", 3.0, _THESIS),
            average("mean offset after at most three", third, "px", 1.0),
            share("centred to 3 px after at most three", [each <= 3.0 for each in third], 95.0),
        ),
        tuple(told),
        {"Offset after one saccade, in px": tuple(first), "Offset after at most three, in px": tuple(third)},
        tuple(pictures),
    )


def after(offsets: list[float], saccades: int) -> float:
    """The offset seen after so many saccades, or after the last one if it was centred before."""
    return float(np.array(offsets)[min(saccades, len(offsets) - 1)])
