"""The model beside its peers: `python -m benchmarks.peers`."""
