"""Settings: from the command line, the environment (FALCONER_*) and `falconer.toml`, in that order.

docs/reference/settings.md describes each; a test holds the two together. Secrets come from the
environment only: files are copied, mailed and committed. A misspelt setting, and one whose
feature is not there yet, is refused rather than passed over: somebody relies on it.
"""

import difflib
import os
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, SecretStr, ValidationError
from pydantic_settings import (
    BaseSettings,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

from server.errors import BadInput

SETTINGS_FILE = "falconer.toml"
PREFIX = "FALCONER_"

ENVIRONMENT_ONLY = frozenset({"cache_dir", "log_format"})
"""Read from the environment by whoever needs them, below this floor; as are all secrets."""

Token = Annotated[SecretStr, Field(min_length=16)]


def without_secret(address: str) -> str:
    """Return an address. Raises ValueError for one with a password: addresses are told to people.

    They stand in the journal, in recordings and in the tables of experiments.
    """
    if "@" in address.split("://", 1)[-1].split("/", 1)[0]:
        raise ValueError("must hold no user and no password: FALCONER_LLM_API_KEY is for the key")
    return address


Url = Annotated[str, Field(pattern=r"^https?://[^/\s]+"), AfterValidator(without_secret)]


class SettingsError(BadInput):
    """Raised when a setting is unknown, out of its range, or in the wrong place."""


class Settings(BaseSettings):
    """Everything a server can be told from outside. Immutable."""

    model_config = SettingsConfigDict(
        env_prefix=PREFIX,
        env_ignore_empty=True,
        toml_file=SETTINGS_FILE,
        extra="forbid",
        frozen=True,
        hide_input_in_errors=True,
    )

    host: str = Field("127.0.0.1", min_length=1, description="Address to listen on.")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on, 0 for a free one.")
    admin_token: Token | None = Field(None, description="Token of those who may do everything.")
    operator_token: Token | None = Field(None, description="Token of those who may steer.")
    viewer_token: Token | None = Field(None, description="Token of those who may only look.")
    session_secret: Token | None = Field(None, description="Signs the cookies of browsers.")
    request_rate: float = Field(
        50.0,
        ge=0.1,
        le=1e6,
        allow_inf_nan=False,
        description="API requests per second that one client may go on asking.",
    )
    llm_base_url: Url | None = Field(
        None, description="OpenAI-compatible endpoint, such as http://127.0.0.1:8080/v1."
    )
    llm_model: str = Field("default", min_length=1, description="Model to ask for there.")
    llm_api_key: SecretStr | None = Field(None, description="Its key, if it wants one.")
    zenoh_connect: str | None = Field(
        None, description="Router or peer to connect to, such as tcp/127.0.0.1:7447."
    )
    zenoh_listen: str | None = Field(
        None, description="Endpoint to listen on for vehicles, such as tcp/127.0.0.1:7447."
    )
    zenoh_user: str | None = Field(None, description="Name to log in to the bus with.")
    zenoh_password: SecretStr | None = Field(None, description="Its password.")
    zenoh_tls_root_ca: Path | None = Field(
        None, description="PEM file of the authority that signs the bus's certificates."
    )
    zenoh_tls_certificate: Path | None = Field(None, description="PEM file of our certificate.")
    zenoh_tls_key: Path | None = Field(None, description="PEM file of its private key.")
    zenoh_tls_mutual: bool = Field(
        default=False, description="Where we listen: ask for the others' certificates too."
    )
    zenoh_users_file: Path | None = Field(
        None, description="Where we listen: file of those who may log in, NAME:PASSWORD lines."
    )
    zenoh_access: Literal["team", "open"] = Field(
        "team", description="Where we listen: whether each party may only say and hear its own."
    )
    zenoh_config_file: Path | None = Field(
        None, description="Zenoh's own file, for everything else; its access rules replace ours."
    )
    database_url: SecretStr | None = Field(
        None, description="Where the journal is kept: sqlite:////file or postgresql://..."
    )
    auto_resume: bool = Field(
        default=False,
        description="Let an interrupted mission fly on by itself, in a simulated world.",
    )
    recordings: Path | None = Field(None, description="Folder that recordings are written to.")
    engine: Literal["fast", "sqp", "ipopt"] | None = Field(
        None, description="Optimizer engine, before the scenario's own."
    )
    log_format: Literal["text", "json"] = Field(
        "text", description="How log lines are written. Read by each process itself."
    )
    cache_dir: Path | None = Field(
        None, description="Folder of the compiled kernels. Read by the solver itself."
    )

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

    def journal_address(self) -> str:
        """Return where the journal is kept: by default a file of this user's, one per port."""
        if self.database_url is not None:
            return self.database_url.get_secret_value()
        return f"sqlite:///{self.state_folder() / f'journal-{self.port}.db'}"

    def state_folder(self) -> Path:
        """Return the folder of what a server keeps: the journal, results of experiments."""
        state = os.environ.get("XDG_STATE_HOME") or "~/.local/state"
        return Path(state).expanduser() / "falconer"

    def operator_tokens(self) -> tuple[str, ...]:
        """Return the tokens that may change things."""
        return _revealed(self.admin_token, self.operator_token)

    def viewer_tokens(self) -> tuple[str, ...]:
        """Return the tokens that may only look."""
        return _revealed(self.viewer_token)

    def tokens(self) -> tuple[str, ...]:
        """Return every token."""
        return self.operator_tokens() + self.viewer_tokens()


def load_settings(**arguments: Any) -> Settings:
    """Return the settings of this process; None among the arguments means not given.

    Raises:
        SettingsError: A setting is misspelt, out of range, or a secret in the file.
            The message never holds a secret.
    """
    _check_environment()
    _check_file(Path(SETTINGS_FILE))
    given = {name: value for name, value in arguments.items() if value is not None}
    try:
        settings = Settings(**given)
    except ValidationError as error:
        raise SettingsError("\n".join(map(_problem, error.errors(include_input=False)))) from None
    return settings


def variable(name: str) -> str:
    """Return the environment variable of a setting."""
    return f"{PREFIX}{name.upper()}"


def _check_environment() -> None:
    known = {variable(name) for name in Settings.model_fields}
    for name, value in os.environ.items():
        if name.upper().startswith(PREFIX) and value and name.upper() not in known:
            raise SettingsError(f"{name}: there is no such setting{_closest(name.upper(), known)}")


def _check_file(path: Path) -> None:
    if not path.is_file():
        return
    try:
        values = tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SettingsError(f"{path} cannot be read: {error}") from error
    for name in values:
        if name not in Settings.model_fields:
            hint = _closest(name, Settings.model_fields)
            raise SettingsError(f"{path}: {name}: there is no such setting{hint}")
        if _is_secret(name):
            raise SettingsError(f"{path}: {name} is a secret: set {variable(name)} instead")
        if name in ENVIRONMENT_ONLY:
            raise SettingsError(f"{path}: {name} has no effect here: set {variable(name)} instead")


def _is_secret(name: str) -> bool:
    return "SecretStr" in repr(Settings.model_fields[name].annotation)


def _closest(name: str, known: Iterable[str]) -> str:
    matches = difflib.get_close_matches(name, list(known), n=1)
    return f", did you mean {matches[0]}?" if matches else ""


def _problem(entry: Any) -> str:
    name = str(entry["loc"][0]) if entry["loc"] else ""
    message = entry["msg"].replace("Input should", "must").replace("Value should", "must")
    message = message.removeprefix("Value error, ")
    return f"{variable(name)}: {message}"


def _revealed(*tokens: SecretStr | None) -> tuple[str, ...]:
    return tuple(token.get_secret_value() for token in tokens if token is not None)
