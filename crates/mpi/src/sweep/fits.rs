//! Which fits a sweep has.

use std::collections::HashSet;
use std::path::Path;

use bokashi_cli::failure::Failure;
use bokashi_cli::plan::fits_of_paper;
use serde::Deserialize;

/// One fit of a sweep.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fit {
    /// The folder of its results.
    pub name: String,
    /// Whether it is a fit of the paper's cube, and not of a scene.
    #[serde(default)]
    pub paper: bool,
    /// What comes after `bokashi fit`, or `bokashi paper fit`, but for where results go.
    pub arguments: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sweep {
    fit: Vec<Fit>,
}

/// Options that the sweep itself gives to each fit.
const OWN: [&str; 3] = ["--out", "--json", "--quiet"];

/// The fits that the file `path` lists.
///
/// # Errors
/// [`Failure::Use`] for a file that can't be read, and for fits that can't be told apart.
pub fn read(path: &Path) -> Result<Vec<Fit>, Failure> {
    let wrong = |message: String| Failure::Use(format!("{}: {message}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
    let Sweep { fit: fits } = toml::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    check(&fits).map_err(wrong)?;
    Ok(fits)
}

fn check(fits: &[Fit]) -> Result<(), String> {
    let mut names = HashSet::new();
    for Fit { name, arguments, .. } in fits {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if name.is_empty() || name.starts_with('.') || !name.chars().all(is_plain) {
            let rule = "a name has letters, digits, '-', '_' and '.', and does not begin with '.'";
            return Err(format!("{rule}: {name:?}"));
        }
        if !names.insert(name) {
            return Err(format!("each fit has a name of its own, and two are {name:?}"));
        }
        let is_own = |word: &&String| OWN.contains(&word.split('=').next().unwrap_or_default());
        if let Some(option) = arguments.iter().find(is_own) {
            return Err(format!("where results go is the sweep's: {name:?} has {option}"));
        }
    }
    match fits {
        [] => Err("a sweep has at least one fit, and this has none".to_owned()),
        _ => Ok(()),
    }
}

/// The paper's experiments 5.1, 5.2 and 5.3 for so many seeds, as `bokashi paper reproduce` has them, but for
/// the fits in f64 that try other choices. Each fit has one thread.
pub fn of_paper(seeds: u64, steps: u64) -> Vec<Fit> {
    let fits = fits_of_paper(seeds, steps).into_iter();
    let one_thread = ["--threads", "1"].map(str::to_owned);
    let fit = |(name, arguments)| {
        let arguments = [arguments, one_thread.to_vec()].concat();
        Fit { name, paper: true, arguments }
    };
    fits.map(fit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fits_of_the_paper_have_names_of_their_own() {
        let fits = of_paper(3, 100);
        assert_eq!(fits.len(), 3 * (9 + 12 + 1));
        assert_eq!(check(&fits), Ok(()));
    }

    #[test]
    fn a_list_that_can_not_be_done_is_refused() {
        let fit = |name: &str, word: &str| Fit {
            name: name.into(),
            paper: false,
            arguments: vec![word.into()],
        };
        for (fits, message) in [
            (vec![], "at least one fit"),
            (vec![fit("a", ""), fit("a", "")], "two are \"a\""),
            (vec![fit("../a", "")], "a name has letters"),
            (vec![fit("a", "--out")], "where results go is the sweep's"),
            (vec![fit("a", "--json=a")], "where results go is the sweep's"),
        ] {
            let refused = check(&fits).unwrap_err();
            assert!(refused.contains(message), "{refused}");
        }
    }
}
