"""Results of whole searches: what is kept of an interrupted run, and their figures."""

import argparse
import json

import intervals_searches
import pytest


def end(seed, arcsec, feasible, method="startrack", claims=True):
    return {
        "design": "noise_only",
        "method": method,
        "seed": seed,
        "arcsec": arcsec,
        "feasible": feasible,
        "claims": claims,
        "seconds": 10.0 * seed,
        "forecasts": 100 + seed,
    }


ENDS = [
    end(1, 2.0, True),
    end(2, 2.2, True),
    end(3, 1.0, False),
    end(4, 3.0, True, claims=False),
    end(1, 1.6, True, "TPE"),
]


def test_regret_is_that_of_feasible_ends_over_the_best_feasible_one_of_all():
    """An infeasible result of 1.0 is not a reference, nor is one of another search."""
    figures = intervals_searches.figures_of(ENDS, ("noise_only", "nanosatellite"))
    assert figures["feasible_ends"] == {"noise_only": 0.75}
    assert figures["claimed_wrongly"] == {"noise_only": 1}
    regret = figures["regret"]["noise_only"]
    assert regret["median"] == pytest.approx(2.2 / 1.6 - 1)
    assert regret["worst"] == pytest.approx(3.0 / 1.6 - 1)
    assert figures["optimize_s"] == {"noise_only": 25.0}
    assert figures["search_peers"]["noise_only"]["TPE"]["regret"]["worst"] == 0


def test_an_end_that_is_kept_is_not_searched_again(tmp_path, monkeypatch):
    """Only the third seed is run; it is evaluated by trials of its own design, and appended."""
    path, judged = tmp_path / "ends.jsonl", []
    path.write_text("".join(json.dumps(one) + "\n" for one in ENDS[:2]))

    def search(case, campaign, seed):
        point = [0.5] * len(campaign.variables)
        return {"branch": "", "point": point, "stays": False, "claims": True, "forecasts": seed}

    def judge(case, campaign, trials):
        judged.append((case.instrument.optics.focal_length, trials))
        return {"arcsec": 1.0, "feasible": True, "margins": {"availability": 0.01}}

    monkeypatch.setattr(intervals_searches, "ours", search)
    monkeypatch.setattr(intervals_searches, "judged_by_trials", judge)
    asked = argparse.Namespace(
        designs=["noise_only"], seeds=3, first=1, peers=0, trials=7, ends=path, quick=False
    )
    figures = intervals_searches.searches(asked)
    assert judged == [(pytest.approx((15e-3 * 70e-3) ** 0.5), 7)]
    assert figures["search_seeds"] == {"noise_only": 3}
    assert [one["seed"] for one in intervals_searches.ends_of(path)] == [1, 2, 3]
