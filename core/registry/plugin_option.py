"""Option type for options whose value is a plugin."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import (
    BaseModel,
    Field,
    GetCoreSchemaHandler,
    SerializationInfo,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
)
from pydantic_core import CoreSchema, core_schema
from typing_extensions import get_protocol_members, is_protocol

from sparsemor.core.errors import InputError
from sparsemor.core.notes import Note
from sparsemor.core.registry.boundary import admit
from sparsemor.core.registry.contracts import origin, refusal
from sparsemor.core.registry.registry import Registry
from sparsemor.core.registry.validation_errors import shown, with_advice


@dataclass(frozen=True, slots=True)
class Slot:
    """Option type for a plugin of one kind: `Annotated[Basis, Slot("basis")]` accepts an instance,
    a name `pod`, or `{use: pod, energy: 0.99}`.

    The name is looked up in the registry of the validation context (key "registry"), or among all
    installed plugins; the options are validated by the plugin class. The class is checked against
    the protocol of its kind. Notes on the choice are appended to the list under the context key
    "notes", if there is one. Serialised as `{use: name, ...}`.
    """

    kind: str

    MARK: ClassVar[str] = "x-sparsemor-slot"
    """JSON-schema key that marks the option for `sparsemor schema`, which inserts the schemas of
    the plugins."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Schema by which pydantic fills an option of the annotated type `source` with a plugin,
        describes it in JSON schemas, and writes it."""
        def fill(value: object, info: ValidationInfo) -> object:
            return self._fill(value, source, dict(info.context or {}))

        open_slot = Annotated[Any, WithJsonSchema({self.MARK: self.kind})]
        return core_schema.with_info_plain_validator_function(
            fill,
            json_schema_input_schema=handler.generate_schema(open_slot),
            serialization=core_schema.plain_serializer_function_ser_schema(
                self._write, info_arg=True
            ),
        )

    def _fill(self, value: object, source: Any, context: dict[str, Any]) -> object:
        """Plugin of an option's value: a name, a mapping with the key `use`, or an instance that
        has what the protocol asks. source: the annotated type of the option, a contract; context:
        that of pydantic, with the "registry" and the list "notes", if they are given."""
        if isinstance(value, str):
            return self._build(value, {}, context)
        if isinstance(value, Mapping):
            options = dict(value)
            name = options.pop("use", None)
            if not isinstance(name, str):
                raise InputError(f"name the {self.kind} with `use: name`", "use")
            return self._build(name, options, context)
        missing = [n for n in sorted(get_protocol_members(source)) if not hasattr(value, n)] if (
            is_protocol(source)) else []
        if value is None or missing or isinstance(value, int | float | list | tuple | set | bytes):
            lacks = f" that has {', '.join(missing)}" if missing else ""
            raise InputError(
                f"give the name of a {self.kind} plugin, or {{use: name, option: value}}, or an "
                f"instance{lacks} (got {shown(value)})")
        broken = refusal(self.kind, type(value))
        if broken:
            raise InputError(f"the {self.kind} {origin(value)} {broken}")
        admit(self.kind, type(value))
        return value

    def _build(self, name: str, options: dict[str, Any], context: dict[str, Any]) -> BaseModel:
        """Plugin of this name with these options, validated."""
        if "registry" not in context:
            context["registry"] = Registry()
        registry: Registry = context["registry"]
        cls = registry.get(self.kind, name)
        passed_over = registry.passed_over(self.kind, name)
        if passed_over:
            context.get("notes", []).append(Note(passed_over, "same_name"))
        try:
            return cls.model_validate(name_default_slots(cls, options), context=context)
        except ValidationError as error:
            raise ValidationError.from_exception_data(name, with_advice(cls, error)) from None

    def _write(self, value: Any, info: SerializationInfo) -> Any:
        if not isinstance(value, BaseModel):
            return value
        registry = (info.context or {}).get("registry") or Registry()
        options = value.model_dump(mode=info.mode, context={"registry": registry})
        return {"use": registry.name_of(self.kind, type(value)), **options}


def slot_default(name: str) -> Any:
    """Default plugin of an option: `sampler: Annotated[Sampler, Slot("sampler")] =
    slot_default("lhs")`.

    Typed `Any`, because the name becomes an instance only during validation.
    """
    return Field(default=name, validate_default=True)


def name_default_slots(cls: type[BaseModel], options: Mapping[str, Any]) -> dict[str, Any]:
    """Options with the name of the default plugin filled in: `solver: {rtol: 1e-9}` without `use`
    sets an option of the default solver."""
    return {key: {"use": use, **value} if isinstance(value, Mapping) and (
        use := _default_plugin(cls, key)) else value for key, value in options.items()}


def _default_plugin(cls: type[BaseModel], key: str) -> str:
    """Name of the default plugin of an option, "" for an option without one."""
    field = cls.model_fields.get(key)
    slot = field is not None and any(isinstance(m, Slot) for m in field.metadata)
    return field.default if field and slot and isinstance(field.default, str) else ""
