# The whole workspace: on a fresh machine `make demo` and `make test` are all that is needed.
.PHONY: help build demo test lint format bench study clean
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
inside := source ./env.sh && PATH="$$PWD/.venv/bin:$$PATH"

help: ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "make %-7s %s\n", $$1, $$2}' Makefile

build: ## .venv and install/; fast when nothing changed; PYTHON=python3.12 chooses the interpreter
	@tools/build

demo: build ## the whole story with a recording of bags/, and one page that tells it (out/story)
	@tools/demo

test: build ## all tests; ARGS='test/unit -k allan' for some
	@tools/test $(ARGS)

lint: build ## ruff and mypy
	@$(inside) && ruff check . && ruff format --check . && mypy

format: build ## let ruff lay out the code
	@$(inside) && ruff check --fix . && ruff format .

bench: ## measure the suite beside its peers (bench/), write docs/benchmarks.md
	@tools/build bench docs && tools/scripts bench && $(inside) && python bench/page.py

study: build ## the Monte Carlo studies (study/)
	@tools/scripts study

clean: ## remove everything that was built, .venv included
	@rm -rf .venv build install log
