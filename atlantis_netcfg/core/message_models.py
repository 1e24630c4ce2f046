"""Models whose texts may be messages: pydantic makes plain text of them, these models keep their values."""

from __future__ import annotations

import json
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, model_validator

from atlantis_netcfg.core import stored_messages


class MessageModel(BaseModel):
    """A frozen model that keeps the values of its messages, also in the JSON of `to_json`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="wrap")
    @classmethod
    def _keep_messages(cls, data: Any, build: ModelWrapValidatorHandler[Self]) -> Self:  # noqa: ANN401 - unchecked yet
        model = build(data)
        if isinstance(data, dict) and (texts := stored_messages.messages_by_text(data)):
            model.__dict__.update(stored_messages.put_back(model.__dict__, texts))
        return model

    def to_json(self, indent: int | None = None) -> str:
        """Return JSON with the marked texts of the messages under `texts`."""
        document = self.model_dump(mode="json") | stored_messages.marked_texts(self)
        return json.dumps(document, ensure_ascii=False, indent=indent)

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Parse JSON of `to_json`; raise ValueError if it is none."""
        return cls.model_validate(stored_messages.parse(text))
