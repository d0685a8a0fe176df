//! The files and settings that a fit was given, in words, and comparisons of them.

use std::collections::BTreeMap;

/// The files and settings that a fit was given: by name, the contents or the value in words.
pub type Given = BTreeMap<String, String>;

/// A file or setting that differs between two fits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// The name of the file or setting.
    pub name: String,
    /// The value of this fit; `None` without one.
    pub this: Option<String>,
    /// The value of the other fit; `None` without one.
    pub other: Option<String>,
}

/// The differences between two fits, by name.
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

/// A value in words, also where there is none.
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
