"""Render the decks of the SimVascular codes."""

from jinja2 import Environment, StrictUndefined

from coronaryuq.flow3d.simvascular import coupled_case
from coronaryuq.flow3d.simvascular.coupled_case import CoupledCase


def render(template: str, case: CoupledCase, escape: bool = False, **values: object) -> str:
    """Return a template filled with a case, its faces and file names, and `values`; `escape` for XML."""
    environment = Environment(
        autoescape=escape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    faces = coupled_case.face_files(case)
    return environment.from_string(template).render(
        case=case,
        settings=case.settings,
        faces=faces,
        caps={name: faces[name] for name in case.coupled.caps},
        mesh=coupled_case.MESH,
        initial=coupled_case.INITIAL,
        network=coupled_case.NETWORK,
        **values,
    )
