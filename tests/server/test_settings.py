"""Settings: where they come from, and what is refused."""

from pathlib import Path

import pytest

from server.settings import PREFIX, Settings, SettingsError, load_settings, variable


@pytest.fixture(autouse=True)
def nothing_set(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Work in an empty folder, with none of our variables in the environment."""
    for name in Settings.model_fields:
        monkeypatch.delenv(variable(name), raising=False)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_defaults_stay_on_this_machine() -> None:
    settings = load_settings()
    assert settings.host == "127.0.0.1"
    assert settings.port == 8000
    assert settings.tokens() == ()


def test_arguments_beat_the_environment_and_the_environment_beats_the_file(
    nothing_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (nothing_set / "falconer.toml").write_text('port = 1001\nhost = "::1"\nllm_model = "m"\n')
    monkeypatch.setenv("FALCONER_PORT", "1002")
    monkeypatch.setenv("FALCONER_HOST", "localhost")
    settings = load_settings(host="127.0.0.2", port=None)
    assert (settings.host, settings.port, settings.llm_model) == ("127.0.0.2", 1002, "m")


def test_an_empty_variable_counts_as_not_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FALCONER_LLM_BASE_URL", "")
    monkeypatch.setenv("FALCONER_DATABASE_URL", "")
    monkeypatch.setenv("FALCONER_WHATEVER", "")
    assert load_settings().llm_base_url is None


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("FALCONER_PORT", "70000", "FALCONER_PORT: must be less than or equal to 65535"),
        ("FALCONER_ENGINE", "quick", "FALCONER_ENGINE: must be 'fast', 'sqp' or 'ipopt'"),
        ("FALCONER_LLM_BASE_URL", "file:///etc/x", "FALCONER_LLM_BASE_URL: "),
        ("FALCONER_LLM_BSE_URL", "http://a", "did you mean FALCONER_LLM_BASE_URL?"),
    ],
)
def test_a_wrong_variable_is_named(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, words: str
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(SettingsError) as caught:
        load_settings()
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("prot = 1", "prot: there is no such setting, did you mean port?"),
        ('llm_api_key = "k"', "llm_api_key is a secret: set FALCONER_LLM_API_KEY instead"),
        ('operator_token = "0123456789abcdef"', "set FALCONER_OPERATOR_TOKEN instead"),
        ('cache_dir = "/tmp"', "set FALCONER_CACHE_DIR instead"),
        ("port = ", "cannot be read"),
    ],
)
def test_a_wrong_file_is_named(nothing_set: Path, text: str, words: str) -> None:
    (nothing_set / "falconer.toml").write_text(text)
    with pytest.raises(SettingsError) as caught:
        load_settings()
    assert words in str(caught.value)
    assert "falconer.toml" in str(caught.value)


def test_secrets_show_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FALCONER_OPERATOR_TOKEN", "0123456789abcdef")
    monkeypatch.setenv("FALCONER_LLM_API_KEY", "a-very-secret-key")
    settings = load_settings()
    assert settings.operator_tokens() == ("0123456789abcdef",)
    for text in (repr(settings), str(settings), settings.model_dump_json()):
        assert "0123456789abcdef" not in text
        assert "a-very-secret-key" not in text


def test_a_refused_secret_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FALCONER_VIEWER_TOKEN", "tooshort")
    with pytest.raises(SettingsError) as caught:
        load_settings()
    assert "FALCONER_VIEWER_TOKEN" in str(caught.value)
    assert "tooshort" not in str(caught.value)
    assert caught.value.__cause__ is None


def test_an_address_holds_no_password(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FALCONER_LLM_BASE_URL", "https://ada:very-secret@host.test/v1")
    with pytest.raises(SettingsError) as caught:
        load_settings()
    assert str(caught.value) == (
        "FALCONER_LLM_BASE_URL: must hold no user and no password: "
        "FALCONER_LLM_API_KEY is for the key"
    )
    monkeypatch.setenv("FALCONER_LLM_BASE_URL", "https://host.test/@ada/v1")
    assert load_settings().llm_base_url == "https://host.test/@ada/v1"


def test_roles_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    for role in ("ADMIN", "OPERATOR", "VIEWER"):
        monkeypatch.setenv(f"{PREFIX}{role}_TOKEN", f"{role}-0123456789abcdef")
    settings = load_settings()
    assert settings.operator_tokens() == ("ADMIN-0123456789abcdef", "OPERATOR-0123456789abcdef")
    assert settings.viewer_tokens() == ("VIEWER-0123456789abcdef",)


def test_every_setting_says_what_it_is() -> None:
    assert [name for name, field in Settings.model_fields.items() if not field.description] == []
