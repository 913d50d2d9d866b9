"""What is on a robot, as lines of text."""

from collections.abc import Mapping
from typing import Any


def screen(host: str, found: Mapping[str, Any]) -> str:
    """The answer to `status` for people; nothing of it can command a terminal."""
    rows = [f"{host}  {found['current'] or 'no release in use'}"]
    rows += [_release(release) for release in found["releases"]]
    rows += [
        f"    {name}  incomplete: an interrupted push; the next push goes on with it" for name in found["incomplete"]
    ]
    rows += [f"  a rollback goes to  {found['rollback_to'] or 'nothing: there is no older healthy release'}"]
    rows += [f"  update              {_update(found)}"]
    rows += [f"  node                {_node(found['node'])}"]
    if found["free_mb"] is not None:
        rows += [f"  free                {found['free_mb']:.0f} MB"]
    return "".join("".join(c if c.isprintable() else "?" for c in row) + "\n" for row in rows)


def _release(release: Mapping[str, Any]) -> str:
    mark = "*" if release["is_current"] else " "
    text = f"  {mark} {release['name']}  {release['state']}  {release['created'][:19]}  {release['by']}"
    notes = [note for note in (release["reason"], release.get("changed", "")) if note]
    return f"{text}  {'; '.join(notes)}".rstrip()


def _update(found: Mapping[str, Any]) -> str:
    pending, last = found["pending"], found["last"]
    if found["is_updating"]:
        return f"under way: {_phase(pending)}" if pending else "under way: nothing is switched yet"
    if pending:
        return f"INTERRUPTED: {_phase(pending)}; settled at the next boot, push or rollback"
    if last is None:
        return "none yet"
    return f"{last['kind']} of {last['release']} {last['ended'][:19]}: {last['outcome']} {last['reason']}".rstrip()


def _phase(pending: Mapping[str, Any]) -> str:
    return f"{pending['kind']} of {pending['release']} in the phase '{pending['phase']}'"


def _node(node: Mapping[str, Any]) -> str:
    status = node.get("status") or {}
    if not status:
        return f"{node['active']} {node.get('reason', '')}".rstrip()
    blocked = "; ".join(map(str, status.get("blocked_by", ()))) or "nothing"
    return f"{node['active']}, {status.get('mode')}, {status.get('rate_hz')} Hz, kept from arming by {blocked}"
