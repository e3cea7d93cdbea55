"""The physical world of a lab: its file, floor, physics, sensors, bound and report, and the server of it all."""

import rmr  # noqa: F401 - from then on compiled modules are found
