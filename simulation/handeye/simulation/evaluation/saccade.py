"""SCS as in the thesis's Fig 4.17: 45 samples; the head moves, then how far off the middle the ball is seen."""

from __future__ import annotations

from collections.abc import Sequence

from handeye.simulation.collecting import FIXATIONS, collect
from handeye.simulation.evaluation.outcome import Figure, average, count, share
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.report import Picture

_OTHER = 100_000  # places of the test have seeds of their own
_PICTURED = 2


def _measure(site: Site, seed: int, trials: int, pictures: list[Picture]) -> list[Trial]:
    """Collects 45 samples by fixating, then looks at balls elsewhere from other poses of the head."""
    experimenter, client = site.experimenter, site.client
    collect("SCS", site.lab, client, seed, site.progress)
    told: list[Trial] = []
    unseen = 0
    with site.progress("saccades", trials) as advance:
        for pan, tilt, place in experimenter.balls(seed + _OTHER):
            if not experimenter.present(pan, tilt, place):
                continue
            job = client.gaze("ball")
            looks = job.result.looks if job.result is not None else ()
            if not looks:  # the arm is before it
                unseen += 1
                continue
            offsets = [look.offset for look in looks]
            failure = "" if job.succeeded else job.failure
            told.append(
                {
                    "pan": pan,
                    "tilt": tilt,
                    "place": place.tolist(),
                    "offsets": offsets,
                    "failure": failure,
                    "unseen_before": unseen,
                }
            )
            unseen = 0
            if len(told) <= _PICTURED:
                pictures.append(
                    Picture(client.frame("left"), f"Seed {seed}, trial {len(told)}: the left picture at its end.")
                )
            advance()
            if len(told) == trials:
                break
    return told


def _figures(trials: Sequence[Trial]) -> tuple[Figure, ...]:
    first, third = ([after(trial["offsets"], saccades) for trial in trials] for saccades in (1, 3))
    return (
        average(f"mean offset after one saccade, {FIXATIONS} samples", first, "px", 3.0, "10.6 px"),
        average("mean offset after at most three", third, "px", 1.0),
        share("centred to 3 px after at most three", [each <= 3.0 for each in third]),
        count(
            "places at which the ball was not seen at first",
            sum(trial["unseen_before"] for trial in trials),
            len(trials),
        ),
    )


def _histograms(trials: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    return {
        f"Offset after {spoken}, in px": tuple(after(trial["offsets"], saccades) for trial in trials)
        for spoken, saccades in (("one saccade", 1), ("at most three saccades", 3))
    }


def after(offsets: list[float], saccades: int) -> float:
    """The offset seen after so many saccades, or after the last one if it was centred before."""
    return float(offsets[min(saccades, len(offsets) - 1)])


EVALUATION = Evaluation("scs", "Gaze (SCS): saccades to a ball from anywhere", _measure, _figures, _histograms)
