# Two commands on a fresh machine with Python 3.11 or newer and make: `make demo` and `make test`.
PYTHON ?= python3
BIN := .venv/bin
PYTHONS ?= $(PYTHON)
RUN := runs/demo
BUILT := umask 022 && $(BIN)/python -m build --no-isolation
INSTALL := $(BIN)/pip install --quiet --require-hashes
COMPILE = build/lock/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-annotate --no-header $(UPGRADE)
ADDED = $(COMPILE) pyproject.toml --constraint locks/run.txt $$(sed -n 's/^\([a-z0-9-]*\)==[^;]*$$/--no-emit-package \1/p' locks/run.txt)

.PHONY: demo test robot expectations dist docs test-thorough test-browser test-slow bench bench-peers learning merging external soak bounds golden types format lock clean

demo: .venv/package
	rm -rf $(RUN)
	$(BIN)/swarmsim run scenarios/basilica.toml --out $(RUN) --video $(RUN).mp4

test: .venv/test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest -n 2 --dist worksteal

# The robot's half as a wheel in dist, for computers on robots.
robot: .venv/package
	$(BIN)/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist ./robot
	@ls dist/swarmsim_robot-*.whl

expectations: .venv/package
	$(BIN)/swarmsim test scenarios

# What takes too long to wait for at every change. CI runs it, too, as far as its time goes.
test-thorough: .venv/test
	$(BIN)/pytest -m thorough -n 2 --dist worksteal $(ARGS)

test-browser: .venv/browser
	$(BIN)/pytest -m browser

# A release: both archives twice, the second time from the first source archive, to the same bytes; their contents checked;
# the wheel used outside the repository by each of PYTHONS with the listed versions, and with the lowest ones that it asks for.
dist: export SOURCE_DATE_EPOCH = $(shell git log -1 --format=%ct)
dist: .venv/dist
	rm -rf dist build/again && mkdir -p build/again
	$(BUILT) --outdir dist .
	tar --extract --gzip --directory build/again --strip-components 1 --exclude PKG-INFO --file dist/*.tar.gz
	$(BUILT) --outdir build/again/dist build/again
	for made in dist/*; do cmp $$made build/again/$$made || exit 1; done
	$(BIN)/twine check --strict dist/*
	$(BIN)/check-wheel-contents dist/*.whl
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	PYTHONS="$(PYTHONS)" $(BIN)/pytest -m dist -s -o faulthandler_timeout=0 tests/test_dist.py
	sha256sum dist/*

docs: .venv/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo build/site/index.html

test-slow: .venv/test
	$(BIN)/pytest -m slow -s -o faulthandler_timeout=0

bench: .venv/test
	$(BIN)/pytest benchmarks -m bench -s

merging: .venv/test
	$(BIN)/python benchmarks/merging/pairs.py
	$(BIN)/python benchmarks/merging/runs.py

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

types: .venv/test
	$(BIN)/mypy --any-exprs-report build/types
	@tail -1 build/types/any-exprs.txt  # expressions without a type, all, and the share that has one
	@tail -1 build/types/any-exprs.txt | awk '{ exit $$NF + 0 < 96.0 }' || { echo "expected 96 % or more"; exit 1; }

format: .venv/test
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# The versions of all packages, with the hashes of their files: what every run needs and what builds the package, then
# what each extra adds to that, also elsewhere (some are needed on some machines alone). Versions stay, unless pyproject.toml or UPGRADE=... (options of uv) asks for others.
lock: build/lock/bin/uv
	echo uv | $(COMPILE) - --output-file locks/uv.txt
	$(PYTHON) -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"], sep="\n")' | \
		$(COMPILE) pyproject.toml - --output-file locks/run.txt
	$(ADDED) --extra test --output-file locks/test.txt
	$(ADDED) --extra browser --constraint locks/test.txt --output-file locks/browser.txt
	$(ADDED) --extra docs --constraint locks/test.txt --output-file locks/docs.txt
	$(ADDED) --extra slurm --constraint locks/test.txt --output-file locks/slurm.txt
	$(ADDED) --extra dist --constraint locks/test.txt --output-file locks/dist.txt
	$(subst --universal,--resolution lowest-direct,$(COMPILE)) pyproject.toml --output-file locks/lowest.txt

clean:
	rm -rf .venv runs build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis

.venv/bin/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "swarmsim needs Python 3.11 or newer; name one with: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 2; }
	$(PYTHON) -m venv .venv

.venv/package: pyproject.toml locks/run.txt | .venv/bin/pip
	$(INSTALL) --requirement locks/run.txt
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

.venv/test: .venv/package locks/test.txt
	$(INSTALL) --requirement locks/test.txt
	touch $@

.venv/browser: .venv/test locks/browser.txt
	@command -v chromium >/dev/null || { echo "the browser tests need chromium; install it, for instance with: apt-get install chromium"; exit 2; }
	$(INSTALL) --requirement locks/browser.txt
	touch $@

.venv/dist: .venv/test locks/dist.txt
	$(INSTALL) --requirement locks/dist.txt
	touch $@

.venv/docs: .venv/package locks/docs.txt
	$(INSTALL) --requirement locks/docs.txt
	touch $@

build/lock/bin/uv: locks/uv.txt
	$(PYTHON) -m venv build/lock
	build/lock/bin/pip install --quiet --require-hashes --requirement $<
	touch $@
