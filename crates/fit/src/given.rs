//! What a fit was given, in words: files and settings by name. Two fits are so held against each other.

use std::collections::BTreeMap;

/// What a fit was given: the name of each file and setting, and in words what it holds.
pub type Given = BTreeMap<String, String>;

/// Where two fits were given something else.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// The file or setting.
    pub name: String,
    /// What this fit has; `None` where it has none.
    pub this: Option<String>,
    /// What the other fit has; likewise.
    pub other: Option<String>,
}

/// What differs between two fits, by name.
pub fn differences(this: &Given, other: &Given) -> Vec<Difference> {
    let others = other.keys().filter(|name| !this.contains_key(*name));
    let mut names: Vec<_> = this.keys().chain(others).collect();
    names.sort_unstable();
    let difference = |name: &String| {
        let (this, other) = (this.get(name).cloned(), other.get(name).cloned());
        (this != other).then(|| Difference { name: name.clone(), this, other })
    };
    names.into_iter().filter_map(difference).collect()
}

/// What a fit has under a name, in words.
pub fn described(value: Option<&String>) -> &str {
    value.map_or("nothing", |value| value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_changed_missing_or_new_is_a_difference() {
        let given = |all: &[(&str, &str)]| -> Given {
            all.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect()
        };
        let own = given(&[("a", "1"), ("b", "2"), ("c", "3")]);
        assert_eq!(differences(&own, &own), []);
        let found = differences(&own, &given(&[("b", "2"), ("c", "4"), ("d", "5")]));
        let words: Vec<_> = found
            .iter()
            .map(|one| (&*one.name, described(one.this.as_ref()), described(one.other.as_ref())))
            .collect();
        let expected = [("a", "1", "nothing"), ("c", "3", "4"), ("d", "nothing", "5")];
        assert_eq!(words, expected);
    }
}
