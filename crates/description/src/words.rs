//! What parsers of JSON and TOML say, in the words of those who write such files.
//!
//! The parsers name types of the program: "invalid type: map, expected struct Lens". A file has objects or
//! tables, lists, texts and numbers.

/// So many characters of a value are kept: a file has values as long as it likes.
const LONGEST: usize = 200;
/// So many characters of another message are kept: it may list all keys of a table.
const LONGEST_MESSAGE: usize = 1000;

/// What a format calls a value with keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Keyed {
    /// Of JSON.
    Object,
    /// Of TOML.
    Table,
}

/// What a parser of JSON says. The place, which its error has apart, is left out.
pub fn json_message(error: &serde_json::Error) -> String {
    let text = error.to_string();
    reword(text.rsplit_once(" at line ").map_or(&text, |(message, _)| message), Keyed::Object)
}

/// What a parser's message says.
pub(crate) fn reword(message: &str, keyed: Keyed) -> String {
    let rest_of = |rules: [&str; 2]| rules.iter().find_map(|rule| message.strip_prefix(rule));
    if let Some(key) = message.strip_prefix("missing field ") {
        return format!("the key {} is missing", short(key));
    }
    if let Some(key) = message.strip_prefix("duplicate field ") {
        return format!("a key is there once, and {} is repeated", short(key));
    }
    if let Some(what) = message.strip_prefix("EOF while parsing ") {
        return format!("the text ends within {what}");
    }
    // A name of a file may have these words, and what is expected comes after it.
    if let Some((given, expected)) = rest_of(["invalid type: ", "invalid value: "])
        .and_then(|given| given.rsplit_once(", expected "))
    {
        let [given, expected] = [given, expected].map(|name| plain(name, keyed));
        return format!("{expected} is needed here, and this is {given}");
    }
    if let Some((given, expected)) =
        message.strip_prefix("invalid length ").and_then(|given| given.split_once(", expected "))
    {
        return format!("{} is needed here, and the length is {given}", plain(expected, keyed));
    }
    match message {
        "recursion limit exceeded" => deep(128),
        "recursion limit" | "cannot recurse further; max recursion depth met" => deep(80),
        "trailing characters" => "a list or the text ends here, and more follows".to_owned(),
        "wanted string or table" => "a text is needed here".to_owned(),
        _ => cut(message, LONGEST_MESSAGE),
    }
}

/// The rule about values in values, which is the parser's.
fn deep(most: usize) -> String {
    format!("a value lies in at most {most} others, and this in more")
}

/// A value or a type, as a parser names it.
fn plain(name: &str, keyed: Keyed) -> String {
    let (first, rest) = name.split_once(' ').unwrap_or((name, ""));
    let table = match keyed {
        Keyed::Object => "an object",
        Keyed::Table => "a table",
    };
    let plain_name = match (first, name) {
        ("struct" | "map", _) | (_, "a map") => table,
        (_, "sequence" | "a sequence") => "a list",
        (_, "f32" | "f64") => "a number",
        // The second is the library's that reads glTF.
        (_, "u32" | "u64" | "usize" | "index into child of root") => "a whole number, 0 or above,",
        (_, "a boolean") => "true or false",
        (_, "a string") => "a text",
        ("string", _) => return format!("the text {}", short(rest)),
        ("boolean" | "integer", _) => return quoted(rest),
        ("floating", _) => return quoted(rest.trim_start_matches("point ")),
        _ => match name.strip_prefix("an array of length ") {
            Some(length) => return format!("a list of {length}"),
            None => return short(name),
        },
    };
    plain_name.to_owned()
}

/// What stands between the first two grave accents.
fn quoted(text: &str) -> String {
    short(text.split('`').nth(1).unwrap_or(text))
}

/// A value whose end is left out where it is long.
fn short(text: &str) -> String {
    cut(text, LONGEST)
}

fn cut(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Default, Deserialize)]
    #[serde(default)]
    #[allow(dead_code, reason = "only what is refused counts")]
    struct Values {
        inner: Inner,
        list: Vec<u32>,
        pair: [f64; 2],
        text: String,
        flag: bool,
    }

    #[derive(Debug, Default, Deserialize)]
    #[allow(dead_code, reason = "only what is refused counts")]
    struct Inner {
        number: f64,
    }

    #[test]
    fn json_is_refused_in_words_of_json() {
        let rows = [
            ("[", "the text ends within a list"),
            ("3", "an object is needed here, and this is 3"),
            ("{\"inner\": {}}", "the key `number` is missing"),
            (
                "{\"inner\": {\"number\": 1, \"number\": 2}}",
                "a key is there once, and `number` is repeated",
            ),
            (
                "{\"inner\": {\"number\": \"x, expected y\"}}",
                "a number is needed here, and this is the text \"x, expected y\"",
            ),
            ("{\"list\": {}}", "a list is needed here, and this is an object"),
            ("{\"list\": [1.5]}", "a whole number, 0 or above, is needed here, and this is 1.5"),
            ("{\"list\": [-1]}", "a whole number, 0 or above, is needed here, and this is -1"),
            ("{\"list\": [null]}", "a whole number, 0 or above, is needed here, and this is null"),
            ("{\"pair\": [1]}", "a list of 2 is needed here, and the length is 1"),
            ("{\"pair\": [1, 2, 3]}", "a list or the text ends here, and more follows"),
            ("{\"text\": []}", "a text is needed here, and this is a list"),
            ("{\"flag\": 0}", "true or false is needed here, and this is 0"),
            ("{\"flag\" 0}", "expected `:`"),
        ];
        for (text, expected) in rows {
            let error = serde_json::from_str::<Values>(text).unwrap_err();
            assert_eq!(json_message(&error), expected, "{text}: {error}");
        }
        let deep = "[".repeat(1000);
        let error = serde_json::from_str::<serde_json::Value>(&deep).unwrap_err();
        assert_eq!(json_message(&error), "a value lies in at most 128 others, and this in more");
    }

    #[test]
    fn toml_is_refused_in_words_of_toml() {
        let rows = [
            ("inner = 3", "a table is needed here, and this is 3"),
            ("list = {}", "a list is needed here, and this is a table"),
            (
                "list = [99999999999999999999]",
                "a whole number, 0 or above, is needed here, and this is 99999999999999999999",
            ),
            ("pair = [true, 1]", "a number is needed here, and this is true"),
        ];
        for (text, expected) in rows {
            let error = toml::from_str::<Values>(text).unwrap_err();
            assert_eq!(reword(error.message(), Keyed::Table), expected, "{text}: {error}");
        }
        for deep in [format!("flag = {}", "[".repeat(1000)), format!("{}a = 1", "a.".repeat(1000))]
        {
            let error = toml::from_str::<Values>(&deep).unwrap_err();
            let said = reword(error.message(), Keyed::Table);
            assert_eq!(said, "a value lies in at most 80 others, and this in more");
        }
    }

    #[test]
    fn long_values_are_cut_between_letters() {
        let text = format!("{{\"flag\": \"{}\"}}", "ä".repeat(1000));
        let error = serde_json::from_str::<Values>(&text).unwrap_err();
        let said = json_message(&error);
        assert!(said.ends_with("ä...") && said.chars().count() < 300, "{said}");
    }
}
