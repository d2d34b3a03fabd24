"""An episode that costs nothing, in a module that costs nothing: worker processes import it."""


def doubled(seed: int, run: int) -> dict[str, int]:
    return {"run": run, "double": 2 * run + seed}
