# What a developer runs. The environment is made on first use, from PyPI, in the versions of constraints.txt.

PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV := .venv
BIN := $(VENV)/bin
DEMO := models/notes/ex05_suspension.lmo
PICTURE := out/suspension.png

.PHONY: help demo test test-random test-machines fuzz lint grammar wasm docs charts bench-quick clean

help:
	@echo "make demo         run the suspension of the notes and draw a picture of it"
	@echo "make test         run the tests"
	@echo "make test-random  run them with fresh random examples"
	@echo "make test-machines  run a hundred scenes as on other machines: BLAS kernels, engines, threads, busy ones"
	@echo "make fuzz         20 000 mutated models: no traceback, nothing slow, nothing large (an hour; resumable)"
	@echo "make lint         check the style and the types of the code"
	@echo "make grammar      write the parser's tables that come with the package"
	@echo "make wasm         build the engine of pages, after a change of its C"
	@echo "make docs         write the pages that are made from the program and the library"
	@echo "make charts       chart speed against accuracy and run the failures of docs/stability.md (ten minutes;"
	@echo "                  ONLY=andrews makes one part anew)"
	@echo "make bench-quick  start-up, scaling and other tools, in under 3 minutes"
	@echo "make clean        remove the environment and everything made"

demo: $(VENV)/.installed
	@mkdir -p $(dir $(PICTURE))
	@$(BIN)/lmoc run $(DEMO) --plot $(PICTURE)

test: $(VENV)/.installed-test
	@$(BIN)/python -m pytest -n 2 -q

test-random: $(VENV)/.installed-test
	@HYPOTHESIS_PROFILE=random $(BIN)/python -m pytest -n 2 -q

test-machines: $(VENV)/.installed-test
	@$(BIN)/python tests/machines.py
	@$(BIN)/python tests/machines.py --again

fuzz: $(VENV)/.installed-test
	@nice $(BIN)/python tests/fuzz.py --count 20000 --jobs 2

lint: $(VENV)/.installed-test
	@$(BIN)/ruff check .
	@$(BIN)/python -m mypy compiler/lmoc
	@$(BIN)/python -m mypy --config-file compiler/strict_types.ini

grammar: $(VENV)/.installed-test
	@$(BIN)/python -c "from lmoc.syntax.tables import write_packaged; write_packaged('grammar/tables.json')"

wasm: $(VENV)/.installed
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt ziglang
	@$(BIN)/python compiler/building/wasm.py

docs: $(VENV)/.installed
	@$(BIN)/python docs/make_diagnostics.py
	@$(BIN)/python docs/make_modelica.py
	@$(BIN)/python editors/tree-sitter/make_grammar.py
	@$(BIN)/python docs/make_library.py
	@$(BIN)/lmoc run $(DEMO) --quiet --plot docs/suspension.png
	@$(BIN)/python docs/make_pictures.py
	@$(BIN)/python docs/make_notes.py
	@$(BIN)/python docs/make_gallery.py

charts: $(VENV)/.installed-test
	@nice $(BIN)/python docs/make_charts.py $(ONLY)

bench-quick: $(VENV)/.installed-test
	@$(BIN)/python -m benchmarks.startup --runs 7
	@$(BIN)/python -m benchmarks.scaling --largest 10000
	@$(BIN)/python -m benchmarks.peers --quick

clean:
	rm -rf $(VENV) out build *.egg-info

$(VENV)/.installed: pyproject.toml constraints.txt setup.py $(wildcard compiler/building/*.py compiler/lmoc/engine/c/*)
	@test -n "$(PYTHON)" || { echo "lmoc needs Python 3.11 or newer (make PYTHON=/path/to/python3 ...)"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing lmoc into $(VENV) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	@echo "installing what the tests need ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@
