# Every target prints its own help: `make` alone lists them.
.DEFAULT_GOAL := help
SHELL := /bin/sh
SITE ?= coastal
ARGS ?=
SHARD ?=
BASE ?=
PART ?=
N ?= 60
SEED ?= 1
BENCH_ARGS ?=
# Four for two cores: many tests wait for an emulated link or for a computer that boots.
WORKERS ?= $(shell expr "$$(nproc 2>/dev/null || echo 2)" "*" 2)
# A file's tests share what they start, and are run by one worker; the dearest files come first (tests/conftest.py).
PYTEST = python -P -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

# Programs of .venv first, for us and for the programs that they start.
export PATH := $(CURDIR)/.venv/bin:$(PATH)
# Container images like to set it; then each of the thousands of processes of a test run would compile our modules anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help rehearse test test-full affected costs quick mutants lint docs pictures campaign satcom test-arm64 bench release clean

help: ## list the targets
	@echo "make TARGET, where TARGET is one of:"
	@sed -n 's/^\([a-z0-9-]*\):[^#]*## \(.*\)/  \1\t\2/p' $(MAKEFILE_LIST) | expand -t 14

rehearse: ## run a site against its emulated devices (SITE=coastal)
	@./provision site=$(SITE) --rehearse --yes

test: ## run the tests that everyone runs, in ten minutes; installs what they need first (ARGS='-k words' chooses)
	@tools/develop system
	@tools/strangers
	@tools/trees
	$(PYTEST) --tier test $(ARGS)

test-full: ## run all tests; with SHARD=2/3 the second third of what `make test` leaves out
	@tools/develop system
	@tools/strangers
	@tools/trees full
	$(PYTEST) $(if $(SHARD),--shard $(SHARD),--tier test) --tier rest $(ARGS)

affected: ## run the tests that import what has changed since main (BASE=REVISION)
	@tools/develop
	@.venv/bin/python -P tools/affected.py $(or $(BASE),main) $(ARGS)

costs: ## run all tests and write tests/costs.tsv, what each file costs
	@$(MAKE) test-full ARGS="--costs tests/costs.tsv"

quick: ## run the quick tests of one part, in about a minute (PART=routeros; alone it lists the parts)
	@tools/develop
	@tools/quick $(PART) $(ARGS)

mutants: ## change a part's code at random places and show what no quick test notices (PART=vpn N=60 SEED=1)
	@tools/develop
	@python tools/mutants.py $(PART) $(N) $(SEED)

lint: ## check code, types, playbooks, roles and pages; no warning is accepted
	@tools/develop
	@tools/lint

docs: ## build the pages with their tree and search, into build/docs
	@tools/develop
	@tools/lint docs
	@echo "open build/docs/index.html"

pictures: ## make the pictures of docs/pictures again, from real runs
	@tools/develop
	@python -P tools/pictures.py

campaign: ## run the long tests: every cut point, every kill point, many seeds
	@tools/develop system
	@tools/strangers
	@tools/trees campaign
	HYPOTHESIS_PROFILE=full python -P -m pytest -n auto --dist worksteal --tier campaign --timeout 0 $(ARGS)

satcom: ## the satellite tests of the report over an emulated link, as root (ARGS='--cell-s 60 --write'; --help)
	@tools/develop system
	PYTHONPATH=.:tests/integration/vpn/network:tests/integration/computers/dds:tests/integration/computers/satcom python -P -m satcom_campaign $(ARGS)

test-arm64: ## boot a gateway's card on the gateways' processor, emulated; once per release, takes half an hour
	@tools/develop system tests/system-packages-arm64.txt
	@tools/arm64
	python -P -m pytest --tier arm64 --timeout 0 $(ARGS)

bench: ## measure us and our peers on slow links, write docs/engineers/benchmarks.md (BENCH_ARGS='--only ours librouteros'; --help)
	@tools/develop system
	@tools/strangers
	python -m bench --write docs/engineers/benchmarks.md $(BENCH_ARGS)

release: ## build the wheel of the newest commit into dist/, install it in an empty environment and use it there
	@tools/develop
	@tools/release

clean: ## remove .venv and everything that tools left behind
	rm -rf .venv .venv-setup .venv-strangers .ansible .mypy_cache .ruff_cache .pytest_cache .hypothesis build dist *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
