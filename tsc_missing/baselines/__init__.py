"""The paper's baselines: policies learned from an offline dataset."""
