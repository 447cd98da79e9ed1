"""What `docs/results/README.md` says of the results beside it: which sites, which network and which code they are of."""

import json
import re
from pathlib import Path

from hilbertvae.files import file_sha256
from hilbertvae.reconstruction.shipped import SHIPPED, checkpoint_path
from hilbertvae.reports.result_json import read_result

RESULTS = Path(__file__).parents[1] / "docs/results"
PAGE = (RESULTS / "README.md").read_text(encoding="utf-8")


def test_results_say_which_simulated_sites_they_trained_on():
    """Those of now, or those from before they were redrawn: every folder of a training on some is named."""
    named = re.search(r"^\| simulated sites were redrawn .*$", PAGE, re.MULTILINE)[0]
    for file in RESULTS.glob("**/result.json"):
        config, folder = read_result(file)[1]["config"], file.relative_to(RESULTS).parts[0]
        if config.get("data", {}).get("simulated") and not config.get("checkpoint"):
            assert f"`{folder}`" in named, folder


def which_network() -> dict[str, tuple[str, str]]:
    """By folder of results, the commit that the page on them says, and what there is to know."""
    page, found = PAGE.split("## Which network, and which code")[1], {}
    for names, commits, note in re.findall(r"^\| (`.*?) \| ([0-9a-f, ]+) \| (.*) \|$", page, re.MULTILINE):
        folders = re.findall(r"`([^`]+)`", names)
        parent = f"{folders[0].partition('/')[0]}/" if "/" in folders[0] else ""
        folders = [parent + folder.removeprefix(parent) for folder in folders]
        each = commits.split(", ")
        found |= {folder: (commit, note) for folder, commit in zip(folders, each * (len(folders) // len(each)), strict=True)}
    return found


def test_results_say_of_each_folder_which_code_scored_it():
    known, made = which_network(), {}
    for file in RESULTS.glob("**/result.json"):
        folder = file.parents[1] if (file.parents[1] / "sweep.json").is_file() else file.parent
        made.setdefault(folder.relative_to(RESULTS).as_posix(), set()).add(read_result(file)[1]["git"]["commit"][:7])
    assert {folder: {commit} for folder, (commit, _) in known.items() if folder in made} == made


def test_results_of_a_network_that_has_since_been_trained_on_say_so():
    for folder, (_, note) in which_network().items():
        file = RESULTS / folder / "result.json"
        about = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {"config": {}}
        name = about["config"].get("checkpoint")
        if name in SHIPPED and about["data"].get("checkpoint") != file_sha256(checkpoint_path(name)):
            assert re.search(rf"`{name}`[^,;]* ago|the same network", note), f"{folder}: {name} is another network by now"
