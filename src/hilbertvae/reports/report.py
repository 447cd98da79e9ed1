"""Everything that is left of an evaluation: `result.json`, tables, pictures and TensorBoard, in one folder."""

from __future__ import annotations

import os
import shlex
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from matplotlib.figure import Figure
from rich.console import Console

from hilbertvae.cloud import Cloud
from hilbertvae.drawing.canvas import corner_note, save_picture
from hilbertvae.drawing.lit_colours import surface_colours
from hilbertvae.drawing.mesh_tab import add_surface
from hilbertvae.drawing.surface import Surface, field_surface, write_ply
from hilbertvae.files import atomic
from hilbertvae.gaps import INSIDE, Gaps
from hilbertvae.grids.cluster_grids import bin_grids, bin_shown, find_frames
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.training_card import ANEW, LEARNED_AS
from hilbertvae.reports.cluster_pictures import (
    completion_rows,
    decodes_alone,
    gapped_clusters,
    in_grid,
    pipeline_picture,
    prior_picture,
    reconstruction_rows,
)
from hilbertvae.reports.comparison import COMPARED, error_table, occlusion_table, pairwise_table
from hilbertvae.reports.further_scores import further_scores
from hilbertvae.reports.hparams import write_hparams
from hilbertvae.reports.mapper_names import for_points
from hilbertvae.reports.paper_table import paper_table
from hilbertvae.reports.provenance import git_state, provenance, without_folders
from hilbertvae.reports.result_json import write_result
from hilbertvae.reports.run_folder import PICTURES, RESULT, SCORES, SURFACE, TENSORBOARD, clear_pictures, site_folder
from hilbertvae.reports.score_pictures import precision_recall_picture, reliability_picture
from hilbertvae.reports.score_table import markdown_scores, print_scores
from hilbertvae.reports.site_pictures import SiteMaps, contact_sheet, gap_zoom_picture, gaps_of, site_map_picture
from hilbertvae.reports.site_view import SiteView, telling_gaps
from hilbertvae.reports.slice_pictures import slice_picture
from hilbertvae.reports.surface_pictures import close_up_picture, site_view_picture
from hilbertvae.reports.tensorboard import scores_writer, site_tag, write_tensorboard
from hilbertvae.reports.uncertainty_pictures import uncertainty_picture
from hilbertvae.scoring.cases import given_cloud
from hilbertvae.scoring.result import Result
from hilbertvae.site import Site

RIVALS = ("lard-hm-fine", "lard-hm", "hm", "nearest")
"""Whose map is shown beside ours: the first of these that was run (the paper's Fig. 5 has LARD-HM)."""
COMPLETIONS = 4
"""Draws of each gap in the picture of completions."""
UNSURE_GAPS = 4
"""Gaps in the picture of uncertainty."""


def scores_text(result: Result) -> str:
    """`scores.md`: the headline scores, methods compared pairwise, what is occluded, how well errors are known, the paper's numbers beside
    ours, and further scores."""
    pairwise = [pairwise_table(result, region) for region in COMPARED]
    compared = [*pairwise, occlusion_table(result), error_table(result), paper_table(result)]
    parts = [markdown_scores(result), *compared, further_scores(result)]
    return "\n\n".join(filter(None, parts)) + "\n"


class Report:
    """A writer of `Result`s: call it with (result, site, mappers) for each site that was scored.

    The first site's `result.json` lies in the folder itself, any other's in a folder of the site's name.
    """

    def __init__(
        self,
        folder: str | Path,
        config: dict,
        identity: dict | None = None,
        seeds: dict | None = None,
        data: dict[str, str] | None = None,
        others: Callable[[], Iterable[tuple[Site, str]]] = list,
        pictures: bool = True,
        card: dict | None = None,
    ):
        """config, identity, seeds, data: see `provenance`. others: opens further sites, with their roles, for the contact sheet. card: of
        the network, where another run trained it."""
        self.folder, self.config, self.identity, self.seeds, self.pictures = Path(folder), config, identity, seeds, pictures
        self.data, self.others, self.card = data or {}, others, card
        self.started = time.perf_counter()
        self.git = git_state(Path(__file__).parent)  # now: the tree may change while a network trains
        self.failed: dict[str, str] = {}
        self.written: list[Path] = []

    def __call__(self, result: Result, site: Site, mappers: dict[str, Mapper]) -> bool:
        """Whether all was written: not where pictures can't be drawn."""
        folder = site_folder(self.folder, site.name, first=not self.written)
        ours = next((m for m in mappers.values() if isinstance(getattr(m, "reconstructor", None), Reconstructor)), None)
        trained = ours.reconstructor.seconds if ours else {}  # also those of a network trained by an earlier run
        seconds = {**trained, "until_scored": time.perf_counter() - self.started}
        device = ours.device if ours else "cpu"
        about = provenance(self.config, identity=self.identity, data=self.data, seeds=self._seeds(mappers), seconds=seconds, device=device)
        about |= {"git": self.git} | ({"card": without_folders(self.card)} if self.card else {})
        if trained and "trained_by" in ours.reconstructor.card:
            about["host"]["trained_by"] = ours.reconstructor.card["trained_by"]
        clear_pictures(folder)
        self.written.append(write_result(folder / RESULT, result, about))
        with atomic(folder / SCORES) as temporary:
            temporary.write_text(scores_text(result), encoding="utf-8")
        print_scores(result, Console())
        drawn = self._drawn(result, site, mappers) if self.pictures and result.scores else ({}, None)
        figures, surface = drawn or ({}, None)
        shown = site_tag(site.name)
        images = {f"{shown}/{tag}": save_picture(figure, folder / PICTURES / f"{tag}.png") for tag, figure in figures.items()}
        first = len(self.written) == 1
        with scores_writer(self.folder / TENSORBOARD, anew=first) as writer:
            if first:
                write_hparams(writer, self.config, result)
            write_tensorboard(writer, result, images, self.config)
            if surface and len(surface):
                write_ply(folder / SURFACE, surface, surface_colours(surface, site.ground))
                add_surface(writer, f"{shown}/surface", surface, site.ground)
        self.failed.update({f"{name} on {site.name}": why for name, why in result.failed.items()})
        if figures:
            print(f"Pictures: {folder / PICTURES}")
        return drawn is not None

    def _seeds(self, mappers: Mapping[str, Mapper]) -> dict | None:
        """Also those of map's weights that the run learned anew, by mapper."""
        cards = {name: getattr(getattr(mapper, "reconstructor", None), "card", {}) for name, mapper in mappers.items()}
        anew = {name: card[LEARNED_AS]["calibration_seeds"] for name, card in cards.items() if card.get(ANEW)}
        return {**(self.seeds or {}), "calibration_anew": anew} if anew else self.seeds

    def _drawn(self, result: Result, site: Site, mappers: Mapping[str, Mapper]) -> tuple[dict[str, Figure], Surface | None] | None:
        """`_figures`, or None where they can't be drawn: scores of hours, which are written by now, don't go with them."""
        try:
            return self._figures(result, site, mappers)
        except Exception as error:
            traceback.print_exc()
            self.failed[f"pictures of {site.name}"] = f"{type(error).__name__}: {error}"
            return None

    def _figures(self, result: Result, site: Site, mappers: Mapping[str, Mapper]) -> tuple[dict[str, Figure], Surface | None]:
        """Pictures by name, and in 3D the surface of our map, or of a rival's where ours is not there."""
        surface = None
        figures = {"precision_recall": precision_recall_picture(result)}
        gaps = gaps_of(result, site, result.gap_seeds[0])
        figures["sites"] = contact_sheet([*self.others(), (site, "test")])
        scored = {name: mapper for name, mapper in mappers.items() if name in result.scores}  # one that failed would fail again
        ours = next((name for name, m in scored.items() if isinstance(getattr(m, "reconstructor", None), Reconstructor)), None)
        rival = next((name for name in RIVALS if name in scored), None)
        shown = given_cloud(site, result.protocol.get("given", "scans"), gaps)

        def fit(name: str, other: Mapper | None = None) -> Mapper:
            mapper = scored[name]
            if "seed" in mapper.get_params(deep=False):
                mapper.set_params(seed=result.gap_seeds[0])
            if other is not None and mapper.fits_like(other):
                return mapper.fit_as(other)
            return mapper.fit(shown.points, shown.occupied, shown.weight)

        fitted = {name: fit(name) for name in (ours, rival) if name}
        of_gaps = {}
        if fitted:
            if site.dimension == 3:
                mapper = fitted[ours or rival]
                by_points = for_points(ours or "")
                view = SiteView.draw(site, gaps, shown, mapper, fit(by_points, mapper) if by_points in scored else None)
                surface = field_surface(view.field, shown.points[shown.occupied])
                of_gaps |= {"map": site_view_picture(view), "gaps": close_up_picture(view), "slices": slice_picture(view)}
                telling = list(telling_gaps(view))[:UNSURE_GAPS]
            else:
                maps = SiteMaps.draw(site, gaps, shown, fitted)
                of_gaps |= {"map": site_map_picture(maps), "gaps": gap_zoom_picture(maps)}
                telling = maps.telling(UNSURE_GAPS)
            if ours and telling and len(fitted[ours].frames_):
                of_gaps["uncertainty"] = uncertainty_picture(fitted[ours], site, gaps, telling)
            inside = site.voxels.select(gaps.part(site.voxels.points) == INSIDE)
            if len(inside):
                answers = {name: (inside.occupied, m.predict_proba(inside.points)[:, 1]) for name, m in fitted.items()}
                of_gaps["reliability"] = reliability_picture(answers, f"{site.name}, voxels in gaps")
        for figure in of_gaps.values():
            corner_note(figure, _which_gaps(result.gap_seeds))
        figures |= of_gaps
        if ours:
            figures |= _network_figures(fitted[ours], site, shown, gaps)
        return figures, surface

    def close(self) -> int:
        """Say where everything is; the exit code, 1 if a mapper failed, or its pictures."""
        for name, why in self.failed.items():
            print(f"Failed: {name}: {why}")
        print(f"Results: {', '.join(map(str, self.written)) or 'none'}")
        tensorboard = Path(os.path.relpath(Path(sys.executable).parent)) / "tensorboard"
        print(f"TensorBoard: {shlex.join([str(tensorboard), '--logdir', str(self.folder)])}")
        return int(bool(self.failed))


def _which_gaps(seeds: list[int]) -> str:
    """Scores are of all gap seeds, pictures of gaps of one."""
    return f"gap seed {seeds[0]}" + (f", the first of {len(seeds)}" if len(seeds) > 1 else "")


def _network_figures(mapper: HilbertMap, site: Site, shown: Cloud, gaps: Gaps) -> dict[str, Figure]:
    """One cluster through the pipeline, reconstructions of clusters with gaps, and what is drawn from the prior: whole grids, or with a
    conditional one several completions of each gap."""
    network = mapper.reconstructor
    frames = find_frames(shown, network.grid, mapper.seed)
    if not len(frames):  # too few returns for any
        return {}
    labels, target = (bin_grids(cloud, frames, network.grid) for cloud in (shown, site.whole))
    chosen = gapped_clusters(labels, target)
    grids = bin_shown(shown, frames.select(chosen), network.grid, network.detailed)
    balls = [in_grid(gaps, frames, int(cluster), network.grid.cells) for cluster in chosen]
    figures = {"pipeline": pipeline_picture(shown, network, frames, labels, target, gaps)}
    draws = network.draws(grids, COMPLETIONS)
    if draws is None:
        figures |= {"prior": prior_picture(network)} if decodes_alone(network) else {}
    elif len(chosen):
        guess = network.complete(grids, flips=1)
        figures["completions"] = completion_rows(labels[chosen], target[chosen], guess, draws, balls, network.likelihood.kind)
    if len(chosen):
        values = network.reconstruct(grids, mapper.flips_)
        figures["reconstructions"] = reconstruction_rows(labels[chosen], target[chosen], values, balls, network.likelihood.kind)
    return figures
