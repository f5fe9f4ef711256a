"""Remake stale artifacts, and remove unneeded ones."""

from __future__ import annotations

from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.physics.effects.trust import trusting
from plop.pipeline.cluster import runner
from plop.pipeline.execute import Outcome
from plop.pipeline.gc import removable, remove
from plop.pipeline.repro import Renewal
from plop.pipeline.tasks import in_order
from plop_cli.console import Console
from plop_cli.listener import Chained
from plop_cli.outcome import outcome_facts, planned_rows


def repro(
    store: Store,
    console: Console,
    addresses: list[str],
    *,
    dry_run: bool,
    scheduler: str | None,
    trust_effects: bool = False,
) -> None:
    """Remake stale or damaged artifacts, with the settings of the manifests; names move to the new ones.

    Args:
        store: The workspace.
        console: Output of the command.
        addresses: Artifacts to remake, with their ancestors; all stale ones of `plop status` when absent.
        dry_run: Show what would run, without running it.
        scheduler: Address of a Dask scheduler whose workers run it.
        trust_effects: Trust the effect files inside a model.

    Raises:
        PlopError: There is no such artifact, it cannot be made again, or whatever a stage reports.
    """
    store.check_begun()
    listener = Chained(console)
    with trusting(trust_effects):
        renewal = Renewal(store, listener)
        again = renewal.tasks([store.find(address) for address in addresses])
        tasks = in_order(again.values())
        if dry_run or not tasks:
            rows = planned_rows(store, tasks)
            console.say("" if rows else "nothing is stale")
            console.table(rows)
            console.result({"would_run": [task.ref.command for task in tasks if task.there is None]})
            return
        outcomes: list[Outcome] = []
        with runner(store, lambda _: listener, scheduler=scheduler, trust_effects=trust_effects) as carries_out:
            for task, outcome in carries_out.run(again.values()):
                if isinstance(outcome, PlopError):
                    raise outcome
                outcomes.append(outcome)
                for name in [name for key, one in again.items() if one is task for name in renewal.names_of(key)]:
                    if store.set_name(name, outcome.artifact) is not None:
                        console.say(f"the name {name} moved to {outcome.artifact.address}")
    console.result({"made": [outcome_facts(outcome) for outcome in outcomes if not outcome.skipped]})


def collect_garbage(store: Store, console: Console, *, delete: bool) -> None:
    """Show the items that can be removed and their size; remove them if requested.

    Raises:
        PlopError: There is no workspace, or an artifact descends from itself.
    """
    store.check_begun()
    found = removable(store)
    gone = remove(store, found) if delete else found
    if store.unreadable():
        console.warn(
            "a manifest cannot be read (see `plop status`): what its artifact needs is unknown, all artifacts are kept"
        )
    console.table([{"what": one.address, "MB": round(one.size / 1e6, 1), "why": one.why} for one in gone])
    megabytes = sum(one.size for one in gone) / 1e6
    if not found:
        console.say("nothing to remove")
    else:
        console.say(
            f"{len(gone)} removed, {megabytes:.1f} MB" if delete else f"{megabytes:.1f} MB can be removed with --delete"
        )
    facts = [{"address": one.address, "bytes": one.size, "why": one.why, "path": str(one.path)} for one in gone]
    console.result({"deleted": delete, "items": facts})
