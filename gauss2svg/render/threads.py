"""How the kernels' threads wait for each other. Imported before anything starts them.

A step is half a dozen short parallel loops. GNU's OpenMP lets a thread that is done spin
until the others are; where another program holds the core that one of those needs, it
spins away whole time slices. Two threads on two cores on which two other programs computed,
a whole run of the command with 6000 Gaussians: 39 s spinning, 8 s asleep.
"""

import os

# Read by the OpenMP library when the first parallel loop loads it; a user's own choice stays.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
