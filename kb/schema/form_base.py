"""What all forms share: strict models, and values with a description that editors show."""

import re
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError

MAX_CLINGO_INTEGER = 2**31 - 1  # clingo counts in 32 bits


class Strict(BaseModel):
    """A mapping that allows only known keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


def _check_whole(value: Any) -> Any:
    if isinstance(value, str) and not re.fullmatch(r"-?[0-9]{1,10}", value):
        raise PydanticCustomError("whole_number", "not a whole number")
    return value


def _check_truth(value: Any) -> Any:
    if isinstance(value, str) and value not in ("true", "false"):
        raise PydanticCustomError("truth", "neither true nor false")
    return value


Expression = Annotated[
    str, Field(description="atoms, terms and constraints, written as in ASP, in one string")
]
Facts = Annotated[list[Expression], Field(description="ground atoms, such as at(bolt, table)")]
Names = Annotated[list[str], Field(description="names, or ranges such as depot_1..4")]
WholeNumber = Annotated[int, BeforeValidator(_check_whole), Field(le=MAX_CLINGO_INTEGER)]
Truth = Annotated[bool, BeforeValidator(_check_truth)]
VariableTypes = Annotated[
    dict[str, str],
    Field(description="variable: type; it narrows the type that the atoms of the entry give"),
]
