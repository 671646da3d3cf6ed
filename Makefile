# SpaceDock, in pipeline order. `make demo` and `make test` do everything themselves, from creating .venv on, once.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

VENV ?= .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
DEMO ?= outputs/demo

.PHONY: help
help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

# ---- set-up

$(BIN)/uv:
	@tools/create_venv.sh $(VENV)
	@touch $@

$(INSTALLED): $(BIN)/uv pyproject.toml constraints.txt
	@echo "installing into $(VENV) (5.5 GB the first time: torch comes with its CUDA libraries)"
	@$(BIN)/uv pip install --compile-bytecode --python $(BIN)/python --constraint constraints.txt --editable '.[dev]'
	@touch $@

.PHONY: setup
setup: $(INSTALLED) ## create .venv and install everything

# ---- the whole pipeline, small

.PHONY: demo
demo: $(INSTALLED) ## demonstrations, ACT, evaluation and report in minutes
	@PATH="$(abspath $(BIN)):$$PATH" tools/demo.sh $(DEMO)

# ---- checks

.PHONY: test
test: $(INSTALLED) ## every test but the slow and the GPU ones
	@$(BIN)/python -m pytest -n 2 --dist loadfile $(PYTEST_ARGS)

.PHONY: test-slow
test-slow: $(INSTALLED) ## the tests that take minutes each
	@$(BIN)/python -m pytest -m "slow and not gpu" $(PYTEST_ARGS)

.PHONY: lint
lint: $(INSTALLED) ## style, and which room may import which
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/lint-imports

.PHONY: format
format: $(INSTALLED) ## let ruff put the style right
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

.PHONY: build
build: $(INSTALLED) ## wheel and source archive in dist/
	@$(BIN)/python -m build --installer uv

.PHONY: constraints
constraints: $(BIN)/uv ## pin the newest versions that pyproject.toml allows; test before you commit them
	@{ echo "# Tested versions, every extra included. Renew: make constraints"; \
	   $(BIN)/uv pip compile pyproject.toml --all-extras --universal --python-version 3.12 --upgrade --quiet \
	       --no-header --no-annotate --no-emit-index-url; } > constraints.txt.new
	@mv constraints.txt.new constraints.txt

.PHONY: clean
clean: ## remove caches and builds; keeps .venv and outputs
	@rm -rf build dist .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	@find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +
