# The verbs: make setup demo up test soak check-compose lint format bench proto openapi sync lock clean
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.set-up
BENCH_STAMP := $(VENV)/.bench-set-up
KERNELS := $(VENV)/.kernels

.PHONY: setup demo up test soak check-compose lint format bench proto openapi sync lock clean

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
test: $(STAMP) $(KERNELS)
	NUMBA_DISABLE_JIT=1 $(BIN)/pytest tests/learner -q
	$(BIN)/pytest

soak: $(STAMP) $(KERNELS)  ## kills the server during writes a hundred times, and damages stores at many more places
	HANDEYE_SOAK=100 HANDEYE_SCHEMATHESIS_EXAMPLES=200 $(BIN)/pytest tests/server/store tests/server/test_schemathesis.py \
		tests/system/test_durability.py

check-compose: $(STAMP)  ## builds the images and runs the stack in containers; some minutes; says why where it cannot
	./tools/check-compose

# numba does not notice when something changes that a kernel calls, and would go on with old machine code.
$(KERNELS): $(STAMP) $(wildcard learner/handeye/rpt/kernels/*.py)
	@find learner experiments -name '*.nb[ic]' -delete
	@touch $@

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(BENCH_STAMP) $(KERNELS)  ## measures RPC, the service, a step and the learner; a quarter of an hour; benchmarks/README.md
	$(BIN)/python benchmarks/rpc.py
	$(BIN)/python -m benchmarks.service.run --output benchmarks/results/service
	$(BIN)/python -m benchmarks.step.run --output benchmarks/results/step
	$(BIN)/python -m benchmarks.learner.run --output benchmarks/results/learner

$(BENCH_STAMP): $(STAMP) requirements-bench.txt
	@$(BIN)/python -c 'import hnswlib' 2>/dev/null || { command -v g++ >/dev/null && \
		test -f "$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h"; } || { \
		echo "hnswlib, which the learner is compared with, is compiled here: that needs g++ and Python's headers." >&2; \
		echo "  Debian 12:     apt-get install g++ python3.11-dev" >&2; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-bench.txt
	@touch $@

proto: $(STAMP)  ## generates the messages' Python from the .proto files
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m grpc_tools.protoc -I proto --python_out=proto --mypy_out=proto proto/handeye/proto/v1/*.proto

openapi: $(STAMP)  ## writes docs/openapi.json, as the running server gives it
	$(BIN)/python -m handeye.server.openapi > docs/openapi.json

sync: $(STAMP)  ## makes the synchronous client of the asynchronous one
	$(BIN)/python tools/make_sync.py

# Needs uv; the file carries versions and hashes, no addresses.
lock:
	uv pip compile --quiet --upgrade --generate-hashes --no-header --no-emit-index-url --python-version 3.11 \
		--extra test --group build pyproject.toml -o requirements.txt
	uv pip compile --quiet --upgrade --generate-hashes --no-header --no-emit-index-url --python-version 3.11 \
		--constraint requirements.txt --group bench -o requirements-bench.txt
	uv pip compile --quiet --generate-hashes --no-header --no-emit-index-url --python-version 3.11 \
		--constraint requirements.txt --extra robot --extra camera --extra client --group build \
		--no-emit-package numba --no-emit-package llvmlite pyproject.toml -o requirements-bridge.txt
	uv pip compile --quiet --generate-hashes --no-header --no-emit-index-url --python-version 3.11 \
		--constraint requirements.txt --extra server --extra postgres --group build pyproject.toml -o requirements-server.txt

clean:
	rm -rf $(VENV) report .mypy_cache .ruff_cache .pytest_cache .hypothesis
