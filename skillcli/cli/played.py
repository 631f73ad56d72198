"""Plans that were played by hand: options of a method may name the artifact of a play."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from skillcli.cli.session import Session

if TYPE_CHECKING:
    from skillcli.composition.method import MethodSpec
    from skillcli.store import ArtifactId


def played_plans(session: Session, source: ArtifactId, spec: MethodSpec, given: Mapping[str, Any]) -> dict[str, str]:
    """Return the plans of plays that options name by their ids, by option; empty if none does.

    Args:
        session: its store has them.
        source: the library that the plan is for.
        spec: the method.
        given: the values of its options.

    Raises:
        StoreError: there is no such play, or it was made with other skills.
    """
    named = {
        option: given[option.name]
        for option in spec.options
        if option.stored and re.fullmatch(rf"[\w.-]+/{option.stored}(-v\d+)?", given.get(option.name) or "")
    }
    if not named:
        return {}
    from skillcli.evaluation.consistency import check_same_skills, skill_names, stored_recipe
    from skillcli.stages.play import plan_of

    store, found = session.store, {}
    for option, text in named.items():
        play = store.read(store.resolve(text, [option.stored]))
        check_same_skills(play, store.read(source))
        recipe = stored_recipe(play)
        found[option.name] = plan_of(play, skill_names(recipe), recipe.task.control_period)
    return found
