# SPDX-License-Identifier: Apache-2.0
"""The part of a diagnosis's report about the laws proposed for an unknown force: curves, sizes, evidence, errors on
runs left out."""

from __future__ import annotations

import numpy as np

from ..diagnosis.laws.code import FILE
from ..diagnosis.laws.result import MODEL_FILE, ProposedLaw
from ..diagnosis.result import Diagnosis, Unknown
from .page import markup, packed, table
from .words import number, ratio, sized

#: Laws drawn over the table, and how.
DRAWN, DASHES = 3, ("solid", "dash", "dot")


def shown_laws(result: Diagnosis) -> tuple[ProposedLaw, ...]:
    """The laws to show: those proposed, else the nearest."""
    laws = result.laws
    return () if laws is None else laws.proposed or ((laws.nearest,) if laws.nearest else ())


def curves(result: Diagnosis, unknown: Unknown, factor: float) -> list[dict[str, object]]:
    """Lines of the best laws over the curve of the table."""
    return [
        {
            "type": "scatter",
            "mode": "lines",
            "name": f"{law.title}, {law.formula}",
            "x": packed(np.asarray(unknown.at, float)),
            "y": packed(factor * np.asarray(law.force, float)),
            "line": {"color": "@after", "width": 2, "dash": dash},
            "hovertemplate": "%{x:.4g}: %{y:.3g}<extra></extra>",
        }
        for law, dash in zip(shown_laws(result)[:DRAWN], DASHES, strict=False)
    ]


def law_section(result: Diagnosis) -> str:
    """The laws with their sizes and evidence, the errors before, with the table and with the law, and what to do with
    them."""
    laws, shown = result.laws, shown_laws(result)
    rows = [
        [
            markup("{}<br><span class='soft'>{}</span>", law.title, law.formula),
            markup("<br>").join(
                markup("<span class='num'>{} {}</span>", p.replace("_", " "), sized(*of))
                for p, of in law.parameters.items()
            ),
            number(law.evidence, 3),
            number(law.p_value, 2),
        ]
        for law in shown
    ]
    caption = (
        f"{laws.tried} closed forms were compared with the table; the best were refitted to all runs in its place."
        " Evidence is twice its natural logarithm, forms and parameters counted. p is the chance of such a misfit if"
        " the law is true."
    )
    told = table(["Law", "Sizes", "Evidence over the table", "p"], rows, caption, words=2)
    return markup("<p>{}</p>", laws.sentence) + told + _errors(result, shown) + _use(result)


def _errors(result: Diagnosis, shown: tuple[ProposedLaw, ...]) -> str:
    if not shown:
        return ""
    first, last, law = result.steps[0], result.steps[-1], shown[0]
    rows = [
        ["the model as it was", ratio(first.reduced_chi2**0.5), ratio(first.heldout_nrmse)],
        ["with the table", ratio(last.reduced_chi2**0.5), ratio(last.heldout_nrmse)],
        [
            f"with {law.title}",
            markup("<strong>{}</strong>", ratio(law.reduced_chi2**0.5)),
            markup("<strong>{}</strong>", ratio(law.heldout_nrmse)),
        ],
    ]
    return table(["", "Error over noise", "on runs left out"], rows)


def _use(result: Diagnosis) -> str:
    if not result.laws.proposed:
        return markup("<p>No law is proposed. The table in <code>model.yaml</code> predicts, it explains nothing.</p>")
    name = result.laws.proposed[0].name
    return markup(
        '<div class="box"><strong>Proposed, not proven.</strong> The laws are in <code>{}</code>, ready to be edited;'
        " <code>{}</code> has the best one in the table’s place. <code>inductrack diagnose CAMPAIGN --effects {}</code>"
        " lets them compete with all known effects, <code>inductrack add {} CAMPAIGN --effects {}</code> adds the"
        " best.</div>",
        FILE,
        MODEL_FILE,
        FILE,
        name,
        FILE,
    )
