//! Text of others on a terminal: what would steer it is shown, not obeyed.
//!
//! Names of files, meshes and materials, and what parsers quote, may have any characters. Escape sequences
//! begin with a control character, which is written as Rust has it: `\u{1b}`. So are characters that turn the
//! direction of writing (Unicode's bidirectional controls), since they make a text look like another.

use std::borrow::Cow;
use std::path::Path;

/// `text` with nothing in it that steers a terminal but its line feeds and tabs.
pub(crate) fn plain(text: &str) -> Cow<'_, str> {
    escaped(text, |c| c.escape_unicode().to_string())
}

/// JSON likewise, where such characters stand in strings alone: they are written as JSON has them.
pub(crate) fn plain_json(json: &str) -> Cow<'_, str> {
    // All of them are below 2^16.
    escaped(json, |c| format!("\\u{:04x}", u32::from(c)))
}

/// A path as a shell takes it, in a command that is to be copied.
pub(crate) fn shell_word(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+,:@%=".contains(c);
    match text.chars().all(is_plain) && !text.starts_with('-') && !text.is_empty() {
        true => text,
        false => format!("'{}'", text.replace('\'', "'\\''")),
    }
}

fn escaped(text: &str, shown: impl Fn(char) -> String) -> Cow<'_, str> {
    if !text.contains(steers) {
        return Cow::Borrowed(text);
    }
    let all = text.chars().map(|c| if steers(c) { shown(c) } else { c.to_string() });
    Cow::Owned(all.collect())
}

fn steers(c: char) -> bool {
    let turns = matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    turns || c.is_control() && !matches!(c, '\n' | '\t')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_steers_a_terminal_is_shown() {
        let text = "a\u{1b}[31m\u{9b}2J\r\u{7f}\u{202e}\u{7}\0ü\tb\n";
        let shown = "a\\u{1b}[31m\\u{9b}2J\\u{d}\\u{7f}\\u{202e}\\u{7}\\u{0}ü\tb\n";
        assert_eq!(plain(text), shown);
        assert!(matches!(plain("plain ü\n"), Cow::Borrowed(_)));
    }

    #[test]
    fn a_path_is_one_word_of_a_shell() {
        for (path, word) in [
            ("a/b_c-1.toml", "a/b_c-1.toml"),
            ("my scene.toml", "'my scene.toml'"),
            ("a;rm -rf $(b)", "'a;rm -rf $(b)'"),
            ("it's", "'it'\\''s'"),
            ("-rf", "'-rf'"),
            ("", "''"),
        ] {
            assert_eq!(shell_word(Path::new(path)), word);
        }
    }

    #[test]
    fn json_stays_what_it_is() {
        let value = serde_json::json!({ "a\u{9b}": "\u{1b}\u{7f}\u{202e}" });
        let text = value.to_string();
        let shown = plain_json(&text);
        assert!(!shown.contains(steers), "{shown}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&shown).unwrap(), value);
    }
}
