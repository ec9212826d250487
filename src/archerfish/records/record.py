"""Records: strict structs whose fields are checked, whether a file or a program makes them."""

import functools
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import msgspec
from msgspec import Meta

from archerfish.errors import InputError, checked_arguments, meant
from archerfish.records.json_files import Number, decode, fault, plain, read_struct, write_json

Text = Annotated[str, Meta(pattern=r"^[^\x00-\x1f\x7f\ud800-\udfff]*\Z", max_length=1000)]
"""A text in one line."""
Angle = Annotated[float, Meta(ge=-100.0, le=100.0)]
"""[rad]."""
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
"""A share of a whole, or a probability."""
Time = Annotated[float, Meta(ge=-10.0, le=10.0)]
"""[s]."""
Duration = Annotated[float, Meta(ge=0.0, le=10.0)]
"""[s]."""
Deviation = Annotated[float, Meta(ge=0.0, le=10.0)]
"""A standard deviation [rad or m]."""
Intervals = dict[str, tuple[Number, Number]]
"""95 % interval of each estimated field."""
Provenance = dict[str, str | int | Number | list[str] | dict[str, str | int | Number | None] | None]
"""Seed, commit, library versions and input hashes of the making."""


class _Checked(msgspec.StructMeta):
    """The type of records, so that an unknown field is named as in a file, with those that there are."""

    def __call__(self, *values: Any, **fields: Any) -> Any:
        self.check_names(fields)
        missing = [field.name for field in _fields(self) if field.required and field.name not in fields]
        if missing and not values:
            raise InputError(f"{self.__name__}: field {missing[0]} is missing; give {', '.join(missing)}")
        return super().__call__(*values, **fields)

    def check_names(self, fields: Mapping[str, Any]) -> None:
        """Refuse a field that there is not.

        Raises:
          InputError: naming it.
        """
        if unknown := sorted(fields.keys() - {*self.__struct_fields__}):
            known = self.__struct_fields__
            remedy = meant(unknown[0], known, f"fields are {', '.join(known)}")
            raise InputError(f"{self.__name__}: there is no field {unknown[0]}; {remedy}")

    @property
    def __signature__(self) -> Any:
        """Fields and their defaults: types with their bounds would fill a screen."""
        signature = super().__signature__
        fields = [field.replace(annotation=field.empty) for field in signature.parameters.values()]
        return signature.replace(parameters=fields)


class Struct(
    msgspec.Struct, metaclass=_Checked, frozen=True, forbid_unknown_fields=True, eq=False, repr_omit_defaults=True
):
    """A record whose fields are checked against their types and bounds, whether a file or a program makes it.

    Raises:
      InputError: naming the field, what it is and what was expected.
    """

    def __post_init__(self) -> None:
        for field in _fields(type(self)):
            name, kind, value = field.name, field.type, getattr(self, field.name)
            value = value if isinstance(value, msgspec.Struct) else plain(value)
            if isinstance(value, dict) and isinstance(kind, _Checked):
                kind.check_names(value)
            try:
                value = msgspec.convert(value, kind, dec_hook=decode)
            except (msgspec.ValidationError, UnicodeEncodeError) as error:
                text = fault(error, value, f".{name}", kind)
                text = text.replace("expected object", f"expected a {getattr(kind, '__name__', 'record')}")
                remedy = "" if "; perhaps" in text else "; correct it"
                raise InputError(f"{type(self).__name__}: {text}{remedy}") from error
            msgspec.structs.force_setattr(self, name, value)

    def replace(self, **changes: Any) -> Self:
        """Return the same record with some fields changed.

        Raises:
          InputError: if there is no field of a name, or a value is out of range.
        """
        return type(self)(**{name: getattr(self, name) for name in self.__struct_fields__} | changes)


_fields = functools.cache(msgspec.structs.fields)


class Record(Struct, frozen=True, kw_only=True):
    """A record with a file of its own."""

    schema: ClassVar[str]  # of its file: name and version
    remedy: ClassVar[str] = "identify again"  # for a file that is not as expected

    @classmethod
    @checked_arguments
    def load(cls, path: str | Path) -> Self:
        """Read a record.

        Raises:
          InputError: if the file is no such record, or a field is missing, unknown or out of range.
        """
        return read_struct(Path(path), cls, cls.schema, cls.remedy)

    @checked_arguments
    def save(self, path: str | Path) -> None:
        """Write the record to a .json file.

        Raises:
          InputError: if it can't be written.
        """
        write_json(Path(path), {"schema": self.schema, **plain(self)})


def check_intervals(intervals: Intervals, names: Collection[str]) -> None:
    """Refuse intervals of other fields than those of some names, and those whose ends are swapped.

    Raises:
      InputError: naming the interval.
    """
    for name, (low, high) in intervals.items():
        if name not in names:
            raise InputError(f"intervals.{name}: there is no such field; expected {', '.join(names)}")
        if low > high:
            raise InputError(f"intervals.{name}: expected low ≤ high, got {low:g} and {high:g}")
