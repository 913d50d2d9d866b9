# make run     set up, run the case study in every seat, and write its report
# make test    set up, lint, check types, run the tests
# make prove   the longer proofs: ten runs through ROS, ten minutes of the loop, real time over vcan
# make bench   how fast this machine runs the loop

VENV := .venv
READY := $(VENV)/.ready

.PHONY: run test lint prove bench clean

run: $(READY)
	$(VENV)/bin/segway-ecc case-study

test: $(READY) lint
	$(VENV)/bin/python -m pytest

lint: $(READY)
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy

prove: $(READY)
	$(VENV)/bin/python -m pytest -m proof --timeout 0 -s
	$(VENV)/bin/python -m hil.kernels.uml --interface vcan0 --interface vcan1 -- \
		env SEGWAY_ECC_IN_GUEST=1 $(CURDIR)/$(VENV)/bin/python -m pytest -m proof tests/kernel/guest

bench: $(READY)
	$(VENV)/bin/segway-ecc bench

$(READY): pyproject.toml deploy/setup.sh
	deploy/setup.sh $(VENV)
	touch $@

clean:
	rm -rf $(VENV) out
