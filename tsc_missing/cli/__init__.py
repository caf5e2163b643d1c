"""The commands, one thin module each; no logic lives here.

NumPy's linear algebra starts no threads in them, which has to be said before NumPy is loaded:
nothing here multiplies matrices with it, and SUMO allocates memory all the time, which is faster
in a process that never had a second thread. Pydantic looks for no plugins, for which it would
read the metadata of every package that is installed.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # torch's threads must not spin on shared cores
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
