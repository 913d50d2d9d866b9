"""The placement study: everything of a plan, side by side on the cores."""

from collections.abc import Iterable

from segway_ecc.hil.parallel import results_of
from segway_ecc.hil.placement.grid import StudyPlan, Task, tasks
from segway_ecc.hil.placement.results import Bound, Cut, Drive, Stop, StudyResult
from segway_ecc.hil.progress import OnProgress


def conduct(plan: StudyPlan, jobs: int, on_progress: OnProgress) -> StudyResult:
    """Run a plan; what is found is the same bits whatever `jobs` is.

    Args:
        plan: What to run.
        jobs: How many processes run at a time; 1 for this one alone.
        on_progress: Called after each task.
    """
    todo = tasks(plan)
    with results_of(_call, todo, jobs) as results:
        return _gathered(results, len(todo), on_progress)


def _call(task: Task) -> Drive | Stop | Cut | Bound:
    return task()


def _gathered(results: Iterable[Drive | Stop | Cut | Bound], total: int, on_progress: OnProgress) -> StudyResult:
    """The results by kind, in the order of the tasks."""
    everything = []
    for result in results:
        everything.append(result)
        on_progress(len(everything), total)
    return StudyResult(
        drives=tuple(r for r in everything if isinstance(r, Drive)),
        stops=tuple(r for r in everything if isinstance(r, Stop)),
        cuts=tuple(r for r in everything if isinstance(r, Cut)),
        bounds=tuple(r for r in everything if isinstance(r, Bound)),
    )
