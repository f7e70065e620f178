"""A folder or a bucket by a Dask cluster: python examples/cluster.py tcp://HOST:8786 PHOTOS OUT.

dask scheduler                                            # on one machine
dask worker tcp://HOST:8786 --nworkers 16 --nthreads 1    # on the others
"""

import sys
from collections import Counter

from distributed import Client

from gauss2svg import Goal, Options, vectorize_many


def main(scheduler: str, photos: str, out: str) -> int:
    """Exit status: 1 if a photo failed. All machines must see PHOTOS and OUT."""
    options = Options(goal=Goal(quality="draft"))
    count = Counter()
    with Client(scheduler) as client:
        print("dashboard:", client.dashboard_link)
        executor = client.get_executor(pure=False)
        for photo in vectorize_many([photos], out, options, executor=executor):
            count["failed" if photo.error else "skipped" if photo.skipped else "written"] += 1
            if photo.error:
                print(photo.input, photo.error, file=sys.stderr)
    print(", ".join(f"{number} {what}" for what, number in sorted(count.items())))
    return 1 if count["failed"] else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:4]))
