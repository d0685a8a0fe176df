//! Arrays by name, as one file has them.

use std::collections::{BTreeMap, HashMap};

use bokashi_core::Tensor;
use bokashi_fit::Stored;

use super::raw_array::RawArray;
use crate::error::{Location, SceneError};

/// So many names are in an error that says which there are.
const MOST_SAID: usize = 8;

/// Arrays by name, in the order in which they were added, or in which a file has them.
#[derive(Debug, Clone)]
pub struct ArrayFile {
    /// Texts by name, which a safetensors file has beside its arrays.
    pub metadata: BTreeMap<String, String>,
    location: Location,
    entries: Vec<(String, Entry)>,
    /// Where each name is among the entries.
    by_name: HashMap<String, usize>,
}

/// What a name stands for.
#[derive(Debug, Clone)]
pub(super) enum Entry {
    Array(RawArray),
    /// Not numbers: what they should be, and what they are. It stands in nobody's way until it is asked for.
    Foreign(String),
}

impl Default for ArrayFile {
    fn default() -> Self {
        Self::from_file(Location::new("arrays in memory"))
    }
}

impl ArrayFile {
    /// No arrays.
    pub fn new() -> Self {
        Self::default()
    }

    /// No arrays so far of the file at `location`.
    pub(super) fn from_file(location: Location) -> Self {
        Self { metadata: BTreeMap::new(), location, entries: Vec::new(), by_name: HashMap::new() }
    }

    /// Adds an array, or puts it in the place of the one that has its name.
    pub fn insert(&mut self, name: impl Into<String>, array: impl Into<RawArray>) {
        let (name, entry) = (name.into(), Entry::Array(array.into()));
        match self.by_name.get(&name) {
            Some(&index) => self.entries[index].1 = entry,
            None => self.add(name, entry),
        }
    }

    /// The file, for errors.
    pub(super) fn location(&self) -> &Location {
        &self.location
    }

    /// The names, in order.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.entries.iter().map(|(name, _)| name.as_str())
    }

    /// The array `name`.
    ///
    /// # Errors
    /// [`SceneError::Content`] where there is none, and where it does not hold numbers.
    pub fn get(&self, name: &str) -> Result<&RawArray, SceneError> {
        match self.by_name.get(name).map(|&index| &self.entries[index].1) {
            Some(Entry::Array(array)) => Ok(array),
            Some(Entry::Foreign(message)) => {
                Err(SceneError::content(location_of(&self.location, name), message))
            }
            None => {
                let mut all: Vec<_> =
                    self.names().take(MOST_SAID).map(|name| format!("{name:?}")).collect();
                match self.entries.len().checked_sub(MOST_SAID) {
                    Some(more @ 1..) => all.push(format!("{more} more")),
                    _ if all.is_empty() => all.push("none".to_owned()),
                    _ => {}
                }
                let message = format!("the arrays are {}, and not {name:?}", all.join(", "));
                Err(SceneError::content(self.location.clone(), message))
            }
        }
    }

    /// The array `name` as a tensor: [`RawArray::tensor`].
    ///
    /// # Errors
    /// As [`ArrayFile::get`] and [`RawArray::tensor`].
    pub fn tensor<T: Stored>(&self, name: &str) -> Result<Tensor<T>, SceneError> {
        self.get(name)?.tensor()
    }

    /// All arrays by name.
    ///
    /// # Errors
    /// [`SceneError::Content`] where one does not hold numbers.
    pub(super) fn arrays(&self) -> Result<Vec<(&str, &RawArray)>, SceneError> {
        self.names().map(|name| Ok((name, self.get(name)?))).collect()
    }

    /// Adds what a file has under `name`.
    ///
    /// # Errors
    /// [`SceneError::Content`] where it has that twice.
    pub(super) fn add_new(&mut self, name: String, entry: Entry) -> Result<(), SceneError> {
        if self.by_name.contains_key(&name) {
            let message = format!("a name is that of one array, and {name:?} is that of two");
            return Err(SceneError::content(self.location.clone(), message));
        }
        self.add(name, entry);
        Ok(())
    }

    fn add(&mut self, name: String, entry: Entry) {
        self.by_name.insert(name.clone(), self.entries.len());
        self.entries.push((name, entry));
    }
}

/// What errors call the array `name` of a file.
pub(super) fn location_of(file: &Location, name: &str) -> Location {
    Location::new(format!("{}:{name}", file.path.display()))
}
