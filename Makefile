# zk0: `make demo` runs a federation whose updates are proven; `make test` runs every test. Both set up what they need.

ROUNDS ?= 1
NODES ?= 3
# Outside the clone, so that checkouts share one build.
export CARGO_TARGET_DIR ?= $(HOME)/.cache/zk0/target
RUST := scripts/with-rust
ZK0 := $(CARGO_TARGET_DIR)/release/zk0

.PHONY: demo test setup build guest fixtures cycles fidelity bench-weight-check bench-ledger bench-train cuda

demo: build
	$(ZK0) demo --rounds $(ROUNDS) --nodes $(NODES)

setup:
	@scripts/setup.sh

build: setup
	$(RUST) cargo build --release --workspace --locked

# `zk0` with `--device cuda` for proving, training and evaluating, and an example that measures proofs. In a target folder of its
# own: with the feature, much
# of what SP1 depends on is built differently. No GPU is needed here. CUDA_ARCHS chooses GPUs: see scripts/with-cuda.
cuda: export CARGO_TARGET_DIR := $(CARGO_TARGET_DIR)-cuda
cuda:
	@scripts/setup.sh cuda
	$(RUST) scripts/with-cuda cargo build --release --workspace --locked --features zk0/cuda --bin zk0 --example prove_synthetic

# The real proof is made last and alone: it wants the memory for itself.
test:
	@scripts/setup.sh guest
	$(RUST) cargo test --release --workspace --locked
	$(RUST) cargo test --release --workspace --locked --test real_proof -- --ignored --nocapture

# Guest cycles and gas of claims per profile and mode, from execute mode, and what each operation takes. Minutes and 3 GB.
cycles: build
	@scripts/setup.sh guest
	$(RUST) circuits/build-guest.sh --budget $(CARGO_TARGET_DIR)/budget.elf
	$(RUST) cargo build --release --workspace --locked --example cycle_budget
	$(ZK0) prover cycles
	$(CARGO_TARGET_DIR)/release/examples/cycle_budget $(CARGO_TARGET_DIR)/budget.elf 1 micro full

# Fixed-point against float32 losses, untrained and trained, up to the published size, with every range. Ten minutes and 5 GB.
fidelity: build
	$(ZK0) fidelity --lerobot tests/fixtures/smolvla_tiny --profile micro --profile full --ranges \
		tests/fixtures/datasets/so100_pickplace tests/fixtures/datasets/so100_stacking tests/fixtures/datasets/so101_pickplace

# The verifier's half of mode `checked` at full size: seconds and memory, two sets of 98 M weights.
bench-weight-check: build
	$(RUST) cargo build --release --workspace --locked --example weight_check
	$(CARGO_TARGET_DIR)/release/examples/weight_check

# Appends and replay of the ledger beside RocksDB, SHA-256 and ed25519 alone, and SP1 proofs a second: JSON lines. Six minutes
# and 4 GB of disk where temporary files go.
bench-ledger: setup
	$(RUST) cargo build --release --workspace --locked --example bench_ledger
	$(CARGO_TARGET_DIR)/release/examples/bench_ledger

# Training steps of SmolVLA against LeRobot's on PyTorch. Twenty minutes on a machine that does nothing else; see the script.
bench-train:
	scripts/bench-train/run.sh

# Rebuilds the guest programs and their verifying keys from source.
guest:
	@scripts/setup.sh guest
	$(RUST) circuits/build-guest.sh
	$(RUST) cargo build --release --workspace --locked --example record_guest
	$(CARGO_TARGET_DIR)/release/examples/record_guest

# Makes the committed ledger and proof anew, by a demo; needed whenever the guest program changes.
fixtures: build
	scripts/renew-fixtures.sh $(ZK0)
