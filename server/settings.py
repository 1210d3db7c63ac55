"""Settings: from the command line, the environment (FALCONER_*) and `falconer.toml`, in that order.

docs/reference/settings.md describes each; a test holds the two together.
"""

from typing import Annotated

from pydantic import Field, SecretStr
from pydantic_settings import (
    BaseSettings,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

SETTINGS_FILE = "falconer.toml"
PREFIX = "FALCONER_"

Token = Annotated[SecretStr, Field(min_length=16)]


class Settings(BaseSettings):
    """Everything a server can be told from outside. Immutable."""

    model_config = SettingsConfigDict(
        env_prefix=PREFIX, toml_file=SETTINGS_FILE, extra="ignore", frozen=True
    )

    host: str = Field("127.0.0.1", description="Address to listen on.")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on, 0 for a free one.")
    admin_token: Token | None = Field(None, description="Token of those who may do everything.")
    operator_token: Token | None = Field(None, description="Token of those who may steer.")
    viewer_token: Token | None = Field(None, description="Token of those who may only look.")
    llm_base_url: str | None = Field(
        None, description="OpenAI-compatible endpoint, such as http://127.0.0.1:8080/v1."
    )
    llm_model: str = Field("default", description="Model to ask for there.")
    llm_api_key: SecretStr | None = Field(None, description="Its key, if it wants one.")
    zenoh_connect: str | None = Field(
        None, description="Router or peer to connect to, such as tcp/127.0.0.1:7447."
    )
    zenoh_listen: str | None = Field(
        None, description="Endpoint to listen on for vehicles, such as tcp/127.0.0.1:7447."
    )
    engine: str | None = Field(None, description="Optimizer engine: fast, sqp or ipopt.")

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Arguments first, then the environment, then the file."""
        return init_settings, env_settings, TomlConfigSettingsSource(settings_cls)

    def operator_tokens(self) -> tuple[str, ...]:
        """Return the tokens that may change things."""
        return _revealed(self.admin_token, self.operator_token)

    def viewer_tokens(self) -> tuple[str, ...]:
        """Return the tokens that may only look."""
        return _revealed(self.viewer_token)

    def tokens(self) -> tuple[str, ...]:
        """Return every token."""
        return self.operator_tokens() + self.viewer_tokens()


def _revealed(*tokens: SecretStr | None) -> tuple[str, ...]:
    return tuple(token.get_secret_value() for token in tokens if token is not None)
