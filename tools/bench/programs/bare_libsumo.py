"""The smallest program that runs a simulation in libsumo: ``HORIZON ARGUMENT…``."""

import sys

import libsumo

libsumo.start(["sumo", *sys.argv[2:]])
libsumo.simulationStep(float(sys.argv[1]))
libsumo.close()
