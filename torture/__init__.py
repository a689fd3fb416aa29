"""The torture set: short simulated recordings with everything wrong that a wind tunnel offers.

Each recording is drawn from a seed, with its truth; `python -m torture` measures them all and
says whether a wrong angle came out without a flag.
"""
