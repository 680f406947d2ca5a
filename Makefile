# Every target sets up what it needs: `make demo` and `make test` work from a bare clone.
PYTHON ?= $(shell for p in python3.11 python3.12 python3; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))' 2>/dev/null \
	&& { echo $$p; break; }; done)
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: pictures demo real test lint types bench clean venv

venv: $(STAMP)

$(STAMP): requirements.lock setup.py setup.cfg pyproject.toml
	@test -n "$(PYTHON)" || { echo 'Python 3.11 or 3.12 is needed: make PYTHON=/path/to/python3.11 ...'; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --retries 10 -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

test: lint types
	# Tried again: discovery between processes can time out on a loaded machine.
	$(BIN)/python -m pytest -n 2 --dist loadfile --reruns 2

demo: $(STAMP)
	$(BIN)/python tools/demo.py

# The README's pictures: the demo's, the shipped maglev recording's and a simulated train's.
pictures: demo
	mkdir -p docs
	cp demo/report/error_along_track.png docs/
	$(BIN)/evaluate maglev bags/maglev_line --methods robust,kalman --output demo/maglev
	cp demo/maglev/error_from_first_balise.png docs/maglev_error.png
	$(BIN)/simulate train --scenario paper --seed 1 --output demo/train_run
	$(BIN)/evaluate train demo/train_run/bag --output demo/train
	cp demo/train/level_error.png docs/train_error.png

# Reads ../shared/data, or the folder that TRACK_LOCALIZATION_DATA names.
real: $(STAMP)
	$(BIN)/python tools/real_kingston.py

bench: $(STAMP)
	@for f in benchmarks/bench_*.py; do echo "== $$f"; $(BIN)/python $$f || exit 1; done

clean:
	rm -rf $(VENV) build install log demo out .mypy_cache .ruff_cache .pytest_cache *.egg-info
