# The verbs: make setup demo up test lint format bench proto lock clean
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.set-up

.PHONY: setup demo up test lint format bench proto lock clean

setup: $(STAMP)

$(STAMP): requirements.txt pyproject.toml
	@./tools/check-machine $(PYTHON)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

demo: $(STAMP)  ## teaches ten demonstrations, then grasps cups at places never shown; writes report/
	$(BIN)/handeye demo

up: $(STAMP)  ## starts router, bridges and server; Ctrl-C ends them
	$(BIN)/handeye up

# The kernels once with the JIT off (plain Python semantics), then everything.
test: $(STAMP)
	NUMBA_DISABLE_JIT=1 $(BIN)/pytest tests/learner -q
	$(BIN)/pytest

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(STAMP)
	$(BIN)/python benchmarks/rpc.py

proto: $(STAMP)  ## generates the messages' Python from the .proto files
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m grpc_tools.protoc -I proto --python_out=proto --mypy_out=proto proto/handeye/proto/v1/*.proto

# Needs uv; the file carries versions and hashes, no addresses.
lock:
	uv pip compile --quiet --upgrade --generate-hashes --no-header --no-emit-index-url --python-version 3.11 \
		--extra test --group build pyproject.toml -o requirements.txt

clean:
	rm -rf $(VENV) report .mypy_cache .ruff_cache .pytest_cache .hypothesis
