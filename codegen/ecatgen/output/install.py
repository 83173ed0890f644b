"""Writes packages into a directory, all of them or none."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from . import swap
from .failures import failures_in_words
from .folder import MANIFEST, Tree, read_folder
from .plan import Plan, make_plan, refuse
from .report import Report


def install(
    out: Path,
    packages: Mapping[str, Tree],
    library: str,
    *,
    check: bool = False,
    force: bool = False,
) -> Report:
    """Writes packages into a directory, each of them in one step.

    Files that were not generated stay in place, and `package.order` names them.

    Args:
        out: The directory, which is made if it does not exist.
        packages: Files of each package by its name, in the order in which a tool loads the
            packages.
        library: Name of the package that the report is about.
        check: Write nothing, only say what would change.
        force: If the user has changed generated files, or has files in the places of new ones, keep
            these under another name. Without it this is an error.

    Raises:
        StateError: Files of the user are in the way, or the disk is full; no earlier file is lost.
        NotPermittedError: The directory cannot be written.
    """
    with failures_in_words(out, "read" if check else "written"), ExitStack() as stack:
        if not check:
            out.mkdir(parents=True, exist_ok=True)
        if out.is_dir():
            stack.enter_context(swap.locked(out, shared=check))
        if not check:
            swap.clean_up(out)
        plans = {name: make_plan(read_folder(out / name), packages[name]) for name in packages}
        copies = {} if check else _carry_out(plans, force=force)
    return _report(out, library, plans, copies)


def _carry_out(plans: Mapping[str, Plan], *, force: bool) -> dict[str, str]:
    """Replaces the folders. Returns the new names of the user's files that had to make room."""
    if not force:
        for plan in plans.values():
            refuse(plan)
    copies: dict[str, str] = {}
    for name, plan in plans.items():
        if plan.is_needed:
            found = plan.copies | swap.replace(plan)
            copies |= {f"{name}/{path}": f"{name}/{copy}" for path, copy in found.items()}
    return copies


def _report(
    out: Path, library: str, plans: Mapping[str, Plan], copies: Mapping[str, str]
) -> Report:
    def all_of(attribute: str) -> tuple[str, ...]:
        paths = {
            f"{name}/{path}"
            for name, plan in plans.items()
            for path in getattr(plan, attribute)
            if path != MANIFEST
        }
        return tuple(sorted(paths - set(copies.values())))

    conflicts = {name: plan.folder.problem for name, plan in plans.items() if plan.folder.problem}
    for name, plan in plans.items():
        conflicts |= {f"{name}/{path}": why for path, why in plan.conflicts.items()}
    return Report(
        library=out / library,
        packages=tuple(plans),
        written=all_of("written"),
        unchanged=all_of("unchanged"),
        removed=all_of("removed"),
        kept=all_of("kept"),
        copies=tuple(sorted(copies.items())),
        regenerated=all_of("regenerated"),
        conflicts=tuple(sorted(conflicts.items())),
    )
