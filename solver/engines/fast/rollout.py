"""Motion over the horizon: plans to paths, and derivatives back from paths to plans."""

from solver.arrays import FloatArray
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Motion


@kernel
def roll(motion: Motion, i: int, u: FloatArray, path: FloatArray, speeds: FloatArray) -> None:
    """Fill positions (H, 2) and velocities (H, 2) that the controls (2H,) lead to."""
    h = motion.step
    for axis in range(2):
        x = motion.positions[i, axis]
        v = motion.velocities[i, axis]
        for k in range(path.shape[0]):
            control = u[2 * k + axis]
            if motion.double:
                x += h * v + 0.5 * h * h * control
                v += h * control
            else:
                x += h * control
                v = control
            path[k, axis] = x
            speeds[k, axis] = v


@kernel
def pull_gradient(
    motion: Motion, slope: FloatArray, speed_slope: FloatArray, gradient: FloatArray
) -> None:
    """Add to the gradient by controls (2H,) what the gradients by the path (H, 2) make."""
    h = motion.step
    for axis in range(2):
        by_x = 0.0
        by_v = 0.0
        for k in range(slope.shape[0] - 1, -1, -1):
            if motion.double:
                by_v += h * by_x + speed_slope[k, axis]
                by_x += slope[k, axis]
                gradient[2 * k + axis] += 0.5 * h * h * by_x + h * by_v
            else:
                by_x += slope[k, axis]
                gradient[2 * k + axis] += h * by_x


@kernel
def pull_hessian(motion: Motion, bend: FloatArray, speed_bend: FloatArray) -> None:
    """Turn the Hessian by positions (2H, 2H) into that by controls, in place."""
    h = motion.step
    half = 0.5 * h * h
    size = bend.shape[0]
    for axis in range(2):
        for column in range(size):
            by_x = 0.0
            by_v = 0.0
            for row in range(size - 2 + axis, -1, -2):
                by_v += h * by_x
                by_x += bend[row, column]
                bend[row, column] = half * by_x + h * by_v if motion.double else h * by_x
    for row in range(size):
        for axis in range(2):
            by_x = 0.0
            by_v = 0.0
            for column in range(size - 2 + axis, -1, -2):
                by_v += h * by_x
                by_x += bend[row, column]
                bend[row, column] = half * by_x + h * by_v if motion.double else h * by_x
    if motion.double:
        _add_speed_bend(h, bend, speed_bend)


@kernel
def _add_speed_bend(h: float, bend: FloatArray, speed_bend: FloatArray) -> None:
    for axis in range(2):
        total = 0.0
        for k in range(speed_bend.shape[0] - 1, -1, -1):
            total += h * h * speed_bend[k, axis]
            if total == 0.0:
                continue
            at = 2 * k + axis
            bend[at, at] += total
            for earlier in range(k):
                before = 2 * earlier + axis
                bend[at, before] += total
                bend[before, at] += total
