"""Seeds of environments on CPU and GPU."""

import numpy as np


def whole_seed(seed, options, *keys):
    """The seed as a Python int, or None. Raises ValueError for unknown options and for other seeds."""
    if options is not None and not (isinstance(options, dict) and options.keys() <= set(keys)):
        found = ", ".join(map(repr, options)) if isinstance(options, dict) else type(options).__name__
        raise ValueError(f"options: {f'a dict with {keys[0]} alone is' if keys else 'none are'} taken; {found} was given")
    whole = isinstance(seed, (int, np.integer)) and not isinstance(seed, bool)
    if seed is not None and not (whole and 0 <= seed < 2**63):
        found = seed if whole else type(seed).__name__
        raise ValueError(f"seed: one whole number from 0 to 2**63 - 1 is needed, for all environments, not {found}")
    return None if seed is None else int(seed)
