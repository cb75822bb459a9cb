# zk0: `make demo` runs a federation whose updates are proven; `make test` runs every test. Both set up what they need.

ROUNDS ?= 1
NODES ?= 3
# Outside the clone, so that checkouts share one build.
export CARGO_TARGET_DIR ?= $(HOME)/.cache/zk0/target
RUST := scripts/with-rust
ZK0 := $(CARGO_TARGET_DIR)/release/zk0

.PHONY: demo test setup build guest fixtures cycles

demo: build
	$(ZK0) demo --rounds $(ROUNDS) --nodes $(NODES)

setup:
	@scripts/setup.sh

build: setup
	$(RUST) cargo build --release --workspace --locked

# The real proof is made last and alone: it wants the memory for itself.
test:
	@scripts/setup.sh guest
	$(RUST) cargo test --release --workspace --locked
	$(RUST) cargo test --release --workspace --locked --test real_proof -- --ignored --nocapture

# Guest cycles and gas of one claim, from execute mode.
cycles: build
	$(ZK0) prover cycles

# Rebuilds the guest program and its verifying key from source.
guest:
	@scripts/setup.sh guest
	$(RUST) circuits/build-guest.sh

# Makes the committed ledger and proof anew, by a demo; needed whenever the guest program changes.
fixtures: build
	scripts/renew-fixtures.sh $(ZK0)
