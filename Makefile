# RMR: `make` lists the targets; `make demo` and `make test` are all that a fresh clone needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# What needs nothing but the sources, then what needs processes, sockets or a clock; of these a failed test runs once more.
PARTS := RMR_COMPILED= $(BIN)/python tests/run_parts.py

.PHONY: help demo test test-fast test-slow test-all fast wheel sbom release lint bench score score-ci site paper ros2 validate-radio lock clean install
help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 24

$(STAMP): pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "rmr needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version). Set PYTHON=..." >&2; exit 2; }
	@echo "[1/3] making a virtual environment in $(VENV) (some seconds)"
	@$(PYTHON) -m venv $(VENV)
	@echo "[2/3] installing about $$(grep -c "==" requirements.lock) locked dependencies, some 300 MB (one to five minutes)"
	@{ $(BIN)/python -m pip install --progress-bar off --require-hashes -r requirements.lock || echo "pip failed"; } | \
		awk '/^(Collecting|Processing) / { sub(".*/", "", $$2); sub("-(py|cp)[0-9].*", "", $$2); printf "      %d: %s\n", ++n, $$2; fflush() } \
			/^Installing collected/ { print "      all " n " are there; unpacking them (up to a minute)"; fflush() } \
			/^pip failed$$/ { failed = 1 } END { exit failed }'
	@echo "[3/3] installing rmr itself (some seconds)"
	@$(BIN)/python -m pip uninstall -qq --yes rmr  # its name before it was rmr-robots; both would own the same files
	@$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $(STAMP)
	@echo "installed: $(BIN)/rmr --help"

install: $(STAMP) ## install into .venv

demo: $(STAMP) ## six robot processes pass a corridor in the order of their deadlines
	$(BIN)/rmr demo
	@echo "(. $(BIN)/activate puts rmr on the path)"

fast: $(STAMP) ## compile what robots spend their time in: the same results in less than half of it
	$(BIN)/python -m rmr.compiled.build

wheel: $(STAMP) ## a wheel in dist/; with RMR_COMPILE=1 one with compiled modules, for this machine's Python
	$(BIN)/python -m hatchling build --target wheel

sbom: $(STAMP) ## the bill of materials (CycloneDX) of what an installation brings, in dist/
	@$(BIN)/python deploy/release/sbom.py dist/rmr-robots.cdx.json

release: $(STAMP) ## a release of main, from VERSION=x.y.z: wheel, sdist, bill of materials, commit and signed tag; pushes nothing
	@$(BIN)/python deploy/release/release.py $(VERSION) $(RELEASE)

test: $(STAMP) ## a verdict in about four minutes: all tests but the slow ones
	$(PARTS) "not slow"

test-fast: $(STAMP) ## the fast tests alone, under a minute, to run while one edits
	$(PARTS) fast

test-slow: $(STAMP) ## the slow tests alone
	$(PARTS) slow

test-all: ## every test, the way CI runs it: `make test`, then the slow ones
	$(MAKE) test
	$(MAKE) test-slow

lint: $(STAMP) ## ruff, mypy --strict, whether mypyc compiles what `make fast` does, and the counts of the tree
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m rmr.compiled.build --check
	$(BIN)/python tests/architecture/counts.py

bench: $(STAMP) ## the figures of docs/benchmarks.md as tables, and as JSON in build/
	$(BIN)/python -m rmr.compiled.build --if-possible
	@missed=; for each in run compile engine columns radio cells gaps; do \
		$(BIN)/python tests/bench/$$each.py || missed="$$missed $$each"; \
	done; test -z "$$missed" || { echo "not all targets are met:$$missed" >&2; exit 1; }

score: $(STAMP) ## all provided labs and thirty drawn ones beside the last landed score: docs/score.md
	RMR_COMPILED= $(BIN)/python tests/score/score.py $(SCORE)

score-ci: $(STAMP) ## the part of the score that CI runs
	RMR_COMPILED= $(BIN)/python tests/score/score.py --ci $(SCORE)

site: $(VENV)/.site ## the pages as a site in build/site, with search; a link that leads nowhere is an error
	@$(BIN)/python deploy/release/documentation.py

$(VENV)/.site: $(STAMP) requirements-site.lock
	@echo "installing the generator of the site, some 100 MB"
	@$(BIN)/python -m pip install --quiet --require-hashes -r requirements-site.lock
	@touch $@

paper: $(VENV)/.paper ## every figure and table of docs/evaluation, from scratch, and which targets are met
	$(BIN)/python -m rmr.compiled.build --if-possible
	$(BIN)/python tests/evaluation/evaluate.py

$(VENV)/.paper: $(STAMP) requirements-paper.lock
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements-paper.lock
	@touch $@

# Without dependencies: rosidl_parser asks for lark-parser, the old name of lark, whose files are those of lark.
ros2: $(STAMP) requirements-ros2.lock ## rclpy and MuJoCo, from wheels: docs/ros2.md
	$(BIN)/python -m pip install --progress-bar off --no-deps --require-hashes -r requirements-ros2.lock

validate-radio: $(STAMP) ## the radio against ns-3, row by row: docs/radio-validation.md
	$(BIN)/python tests/validation/validate.py --seeds 10 --write docs/radio

lock: $(STAMP) ## pin every dependency with hashes, without addresses
	$(BIN)/uv pip compile --quiet --universal --generate-hashes --no-header --no-emit-index-url \
		--extra cluster --extra dev --extra editor --extra foxglove --extra keys \
		--extra maps --extra plot \
		--output-file requirements.lock pyproject.toml build-requirements.in
	$(BIN)/uv pip compile --quiet --universal --generate-hashes --no-header --no-emit-index-url \
		--extra paper --constraint requirements.lock --output-file requirements-paper.lock pyproject.toml
	$(BIN)/uv pip compile --quiet --universal --generate-hashes --no-header --no-emit-index-url \
		--extra interfaces --extra ros2 --extra mujoco --no-emit-package lark-parser --constraint requirements.lock \
		--output-file requirements-ros2.lock pyproject.toml
	$(BIN)/uv pip compile --quiet --universal --generate-hashes --no-header --no-emit-index-url \
		--extra site --constraint requirements.lock --output-file requirements-site.lock pyproject.toml

clean: ## remove what builds and runs leave behind
	rm -rf $(VENV) build dist runs .mypy_cache .ruff_cache .pytest_cache .hypothesis
