"""The train paper's Figures 3 to 6 with our methods beside its own, of one simulated run."""

from __future__ import annotations

from pathlib import Path

from track_localization.cli.train.reproduce_runs import CASES, PLAIN, SMOOTHED_MAP, results
from track_localization.evaluation import plots_train_paper
from track_localization.evaluation.navigation_metrics import navigation_errors
from track_localization.sim.train import scenario, simulate_train
from train_localization.methods import INS, MAP, PAPER, ROBUST, SMOOTHED

CASE = 'paper'
SINS_DR = (PAPER, PLAIN, ROBUST, MAP)
"""What takes the place of the paper's SINS/DR in its Figure 5, the paper's own first."""
ALL = (INS, PAPER, PLAIN, ROBUST, MAP, SMOOTHED, SMOOTHED_MAP)


def draw(folder: Path, seed: int) -> list[Path]:
    """Draw ``fig3.png`` to ``fig6.png`` of the paper's scenario; return their paths."""
    case = CASES[CASE]
    run = simulate_train(scenario(case.scenario), seed)
    found = dict(results(run, case, ALL))
    tracks = {name: one.trajectory for name, one in found.items() if len(one.trajectory)}
    truth, outage = run.truth(), run.outages[0]
    errors = {
        name: navigation_errors(one.trajectory, one.velocity_covariance, truth)
        for name, one in found.items()
        if name in tracks
    }
    folder.mkdir(parents=True, exist_ok=True)
    coasting = {INS: tracks[INS]} if INS in tracks else {}
    reckoned = {name: tracks[name] for name in SINS_DR if name in tracks}
    return [
        plots_train_paper.line(folder / 'fig3.png', truth, outage),
        plots_train_paper.increments(
            folder / 'fig4.png', coasting, truth, outage, 'Fig. 4: BDS/SINS coasts'
        ),
        plots_train_paper.increments(
            folder / 'fig5.png', reckoned, truth, outage, 'Fig. 5: SINS/DR'
        ),
        plots_train_paper.errors(folder / 'fig6.png', errors, outage, float(truth.time_s[0])),
    ]
