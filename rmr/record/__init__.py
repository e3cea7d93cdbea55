"""Recordings of runs: MCAP files (https://mcap.dev/spec) with the channels of `rmr.record.channels`."""
