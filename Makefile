# Two commands on a fresh machine with Python 3.11 or newer and make: `make demo` and `make test`.
PYTHON ?= python3
BIN := .venv/bin
RUN := runs/demo

.PHONY: demo test docs test-browser test-slow bench bench-peers learning merging external soak bounds golden format clean

demo: .venv/package
	rm -rf $(RUN)
	$(BIN)/swarmsim run scenarios/basilica.toml --out $(RUN) --video $(RUN).mp4

test: .venv/test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest -n 2 --dist worksteal

test-browser: .venv/browser
	$(BIN)/pytest -m browser

docs: .venv/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo build/site/index.html

test-slow: .venv/test
	$(BIN)/pytest -m slow -s -o faulthandler_timeout=0

bench: .venv/test
	$(BIN)/pytest benchmarks -m bench -s

merging: .venv/test
	$(BIN)/python benchmarks/merging/merging.py

external: .venv/test
	$(BIN)/python benchmarks/external/external.py

learning: .venv/test
	$(BIN)/python benchmarks/learning/train.py

bench-peers: .venv/test .venv-irsim/done .venv-vmas/done
	$(BIN)/pytest benchmarks/test_workload.py -m bench -s

.venv-irsim/done: benchmarks/peers/irsim.txt
	$(PYTHON) -m venv .venv-irsim && .venv-irsim/bin/pip install --quiet --requirement $< && touch $@

.venv-vmas/done: benchmarks/peers/vmas.txt
	$(PYTHON) -m venv .venv-vmas && .venv-vmas/bin/pip install --quiet --requirement $< && touch $@

soak: .venv/test
	$(BIN)/pytest -m slow -s -o faulthandler_timeout=0 tests/generated tests/recording/test_damage.py tests/cli/test_whatever_is_typed.py tests/cli/test_full_disk.py

bounds: .venv/test
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=build/bounds $(BIN)/pytest -n 2 tests/kernels tests/test_docs.py -k "kernels or every_scenario_runs"

golden: .venv/test
	$(BIN)/python tests/test_golden.py

format: .venv/test
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf .venv runs build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis

.venv/bin/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "swarmsim needs Python 3.11 or newer; name one with: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 2; }
	$(PYTHON) -m venv .venv

.venv/package: pyproject.toml constraints.txt | .venv/bin/pip
	$(BIN)/pip install --quiet --constraint constraints.txt --editable .
	touch $@

.venv/test: pyproject.toml constraints.txt | .venv/bin/pip
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[test]'
	touch $@

.venv/browser: .venv/test
	@command -v chromium >/dev/null || { echo "the browser tests need chromium; install it, for instance with: apt-get install chromium"; exit 2; }
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[test,browser]'
	touch $@

.venv/docs: .venv/package
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[docs]'
	touch $@
