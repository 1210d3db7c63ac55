"""How several processes share the tests (`--numprocesses`)."""

from xdist.scheduler import LoadFileScheduling
from xdist.workermanage import WorkerController


class BothEnds(LoadFileScheduling):  # type: ignore[misc] # xdist has no types
    """Whole files: one process takes them from the front, the others from the end.

    What other processes time stands in front, so it seldom has the like of it beside it.
    """

    def _assign_work_unit(self, node: WorkerController) -> None:
        if node is not self.nodes[0]:
            self.workqueue.move_to_end(next(reversed(self.workqueue)), last=False)
        super()._assign_work_unit(node)
