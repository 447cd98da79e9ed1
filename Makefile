# `make run` and `make test` set up .venv from pinned constraints on a fresh machine, and reuse it.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: help install run run-3d test fuzz clean
.DEFAULT_GOAL := run

# Containers often tell Python to keep no compiled files; then each process would compile torch and all the rest anew, for most of its start.
export PYTHONDONTWRITEBYTECODE :=

# --no-compile: Python compiles what it imports when it does, which is a small part of torch.
# The version is looked at first: pip would only say that pins conflict, and .venv would keep to the older Python when another one is given.
$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "hilbertvae needs Python 3.11 or newer, and this is %d.%d: make PYTHON=python3.11 ..." % sys.version_info[:2])'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check --constraint constraints.txt torch
	$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check --constraint constraints.txt --editable '.[sim,points,bags,poses,dev]'
	touch $@

help:  ## What can be made
	@grep -E '^[a-z0-9-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 10

install: $(READY)  ## The package in .venv, with all extras but rerun, slurm, ray and bench

run: $(READY)  ## Train on simulated buildings, score on another one, leave pictures and result.json in outputs/run
	$(BIN)/hilbertvae-train

run-3d: $(READY)  ## The same with simulated streets and a spinning lidar, in outputs/streets
	$(BIN)/hilbertvae-train experiment=streets

test: $(READY)  ## The whole suite, lint and the one-way flow of imports
	$(BIN)/ruff check src tests benchmarks
	$(BIN)/lint-imports
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal --durations 30 --durations-min 5  # one thread in each worker: two torch processes with two each fight

ROUNDS ?= 5

fuzz: $(READY)  ## Tests of laws and of damaged files, on examples drawn anew in each of ROUNDS
	for round in $$(seq $(ROUNDS)); do OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal -m hypothesis --hypothesis-profile fuzz || exit 1; done

clean:  ## Remove what run and run-3d have left
	rm -rf outputs/run outputs/streets outputs/cache
