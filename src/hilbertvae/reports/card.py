"""The card of a network that comes with the package: trained on what, by what, how good, where it fails, and under whose terms."""

from __future__ import annotations

import re
from pathlib import Path

from hilbertvae.files import file_sha256
from hilbertvae.mappers.weights import occupied_weight_of
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.shipped import SHIPPED
from hilbertvae.reconstruction.training_card import LEARNED_AS, OLDER, calibrated_on, stages
from hilbertvae.reports.mapper_names import CHAMPIONS
from hilbertvae.reports.result_json import read_result
from hilbertvae.reports.score_table import NOTHING, as_percent, markdown, mean_and_spread, told_given
from hilbertvae.scans.sites import find_site
from hilbertvae.scoring.result import Result, asked
from hilbertvae.simulate.street_variety import VARIETIES
from hilbertvae.site import SIMULATED

TERMS = {
    "ple": "Laser logs collected at github.com/acschaefer/ple, which states no terms for the data.",
    "kitti": "KITTI (A. Geiger et al., 2013): CC BY-NC-SA 3.0.",
    "nuscenes": "nuScenes (H. Caesar et al., 2020): CC BY-NC-SA 4.0.",
    "nclt": "NCLT (N. Carlevaris-Bianco et al., 2016): see its authors' page.",
    "rellis": "RELLIS-3D (P. Jiang et al., 2021): CC BY-NC-SA 3.0.",
}
"""Of scans, by a word in a site's name; 2D logs are all of one source."""
LIMITS = {
    2: "Made for buildings at {at}: outdoors, or at another resolution, it has never been tried.",
    3: "Made for streets at {at}, with the vertical as the third axis: thin poles, the far ends of cars and hedges are guessed coarsely, "
    'and rooms {rooms} simulation alone (docs/decisions.md, "Rooms in space").',
}
"""`at`: which cells and boxes; `rooms`: one of `ROOMS`."""
ROOMS = {False: "have been tried in", True: "were learned from, and tried in,"}
"""By whether floors of buildings are among what a network in 3D was trained on."""
GUESSES = (
    "What it fills in is a guess from other places; `observed(points)` tells what was seen. Rows `occluded` are of what no scan "
    "that it was shown had seen: where its NLL there is above the base rate's, knowing only the share of occupied cells would do better."
)
FOR_MAPS = " It was shown labels of cells alone, as of an existing map: of scans, which tell more, one for scans makes more."
FURTHER = {
    "mean_with_step_before": " What comes out is the mean of these weights and those of {before}.",
    "added": " What this changed in the network that it trained is added to the weights of the step before.",
}
"""What became of a training's weights, by what a card says of it; `before`: with which step's the mean was taken."""
STEPS = (
    "Each step began with the weights of the one before. Those are not kept, so the commands record what was done, and can't be run again "
    "as they stand (`train.py` is `hilbertvae-train`).\n\n"
)
COLUMNS = {
    "precision": "P", "recall": "R", "best_f1": "best F1", "auc": "AUC", "nll": "NLL", "ece": "ECE", "base_rate": "base rate",
    "base_rate_nll": "its NLL",
}  # fmt: skip
SHARES = ("precision", "recall", "best_f1", "auc", "base_rate")


def card_text(name: str, weights: Path, results: list[Path]) -> str:
    """Markdown about the network shipped as `name`, from the header of its file and from result files."""
    network, scored = Reconstructor.load(weights), [read_result(path) for path in results]
    card = network.card
    count = sum(parameter.numel() for parameter in network.network.parameters())
    at = f"cells of {network.grid.cell_m:g} m and boxes of {network.grid.cells * network.grid.cell_m:g} m"
    lines = [
        f"# {name}: {SHIPPED[name]}",
        f'`hilbertvae.load_mapper("{name}")`. {count:,} weights, as int8 with a scale per channel; {weights.stat().st_size:,} bytes; '
        f"sha256 `{file_sha256(weights)}`. Grids of {network.grid.cells}^{network.dimension} cells of {network.grid.cell_m:g} m.",
        "## Trained",
        _trained(card),
        f"The Hilbert Map's weights were learned on {', '.join(calibrated_on(card))}{_drawn(card, network.dimension)}{_given(card)}, "
        + f"over {card['flips']} flip{'s' if card['flips'] > 1 else ''}"
        + (f", in frames turned as `{turned}`" if (turned := network.grid.frame.rotation) != "none" else "")
        + (f", {_between_cells(network.grid.interpolated)}" if network.grid.interpolated else "")
        + f"; in those for points an occupied one counts for {occupied_weight_of(network.map_weights):g}.",
        "## Scores",
        *([_scores([result for result, _ in scored]), _made(scored)] if scored else ["Not scored yet."]),
        "## Limits",
        f"{LIMITS[network.dimension].format(at=at, rooms=ROOMS[_knows_floors(card)])} {GUESSES}{FOR_MAPS if _given(card) else ''}",
        "## Terms",
        _terms(card),
    ]
    return "\n\n".join(lines) + "\n"


def _knows_floors(card: dict) -> bool:
    """Whether simulated floors are among what it was trained on, as `many_simulated` says it."""
    return any(re.match(r"\d+ simulated .*floors", site) for stage in stages(card) for site in stage["trained_on"])


def _drawn(card: dict, dimension: int) -> str:
    """How simulated sites among them differ, where that is not as usual, as more words; older cards don't say."""
    data = card.get(LEARNED_AS, {}).get("data", {})
    variety = data.get("simulated_variety") if dimension == 2 else data.get("street", {}).get("variety")
    kind = "buildings" if dimension == 2 else VARIETIES[variety or "usual"].kind
    told = variety not in (None, "usual") and any(site.startswith(SIMULATED) for site in calibrated_on(card))
    how = kind if "floors" in kind else f"{kind} of {variety} variety"
    return f" ({how})" if told else ""


def _given(card: dict) -> str:
    """What the map's weights were learned from, where that was not scans, as more words."""
    return told_given({"given": (OLDER | card.get(LEARNED_AS, {}))["calibration_given"]})


def _between_cells(interpolated: bool | str) -> str:
    """How its maps are read, if any are read between cells."""
    return "read between cells" if interpolated is True else f"those for {interpolated} read between cells"


def _trained(card: dict) -> str:
    said, numbers = [], {}
    for number, stage in enumerate(stages(card), start=1):
        command = f", by `{' '.join(stage['command'])}`" if "command" in stage else ""
        commit = f" at commit {stage['git']['commit'][:7]}" if stage.get("git") else ""
        told = (
            f"On {', '.join(stage['trained_on'])}, best weights by {stage['validated_on']}: epoch {stage['epoch']}, "
            f"step {stage['steps']}, seed {stage['seed']}{command}{commit}."
        )
        first = numbers.setdefault(told, number)
        if first < number and stage.get("added"):
            said.append(f"{number}. What step {first} changed is added once more.")
        else:
            back = int(stage.get("mean_with_step_before", 1))  # steps, or `True`
            before = f"step {number - back}" if back > 1 else "the step before"
            said.append(f"{number}. {told}{''.join(words.format(before=before) for key, words in FURTHER.items() if stage.get(key))}")
    return (STEPS if len(said) > 1 else "") + "\n".join(said)


def _scores(results: list[Result]) -> str:
    rows = []
    for result in results:
        site = result.site + told_given(result.protocol)
        for reading, names in CHAMPIONS.items():
            mapper = next((name for name in names if name in result.scores), "")
            for region, metrics in result.regions(mapper, reading).items():
                if region in ("observed", "gaps", "gaps-above-ground") or region.startswith("occluded"):
                    rows.append([site, region, reading, *(_cell(metrics, metric) for metric in COLUMNS)])
    return markdown(["site", "region", "reading", *COLUMNS.values()], rows, words=(1, 2))


def _cell(metrics: dict[str, list[float]], metric: str) -> str:
    values = asked(metrics, metric)
    if not values:
        return NOTHING
    mean, spread = mean_and_spread(values)
    return as_percent(mean, spread) if metric in SHARES else f"{mean:.3f}"


def _made(scored: list[tuple[Result, dict]]) -> str:
    said, sizes = [], " and ".join(f"{size:g}" for size in sorted({result.gap_diameter_m for result, _ in scored}))
    for result, about in scored:
        commit = (about.get("git") or {}).get("commit", "")[:7]
        site = result.site + told_given(result.protocol)
        said.append(f"`{' '.join(about['command'])}` at commit {commit} ({site}, gap seeds {result.gap_seeds})")
    return (
        f"Shares in percent, mean±sd over gap seeds of {sizes} m; precision and recall at p > 0.6, precision over the seeds in which "
        "anything was called occupied. observed: held-out beams. Points are scored "
        'with `calibration="points"`. By ' + "; ".join(said) + "."
    )


def _terms(card: dict) -> str:
    sites = sorted(
        {site for stage in stages(card) for site in (*stage["trained_on"], stage["validated_on"], *calibrated_on(stage)) if " " not in site}
    )
    real = [site for site in sites if not site.startswith("simulated")]
    if not real:
        return (
            "Trained on simulated sites alone, which its map's weights are of, too: nobody's scans are in it. Real sites had a say in some "
            "choices (docs/decisions.md). MIT, as the package."
        )
    dimension = find_site(real[0]).dimension
    known = [TERMS["ple"]] if dimension == 2 else [text for word, text in TERMS.items() if any(word in s for s in real)]
    return (
        "Learned from real scans, whose owners' terms may reach to what is learned from them. Where that matters, the package has "
        f"`{dimension}d-sim`, trained on simulated sites alone.\n\n" + "\n".join(f"- {text}" for text in known)
    )
