//! Constants in the type of numbers that a step has.

use std::any::Any;
use std::sync::{Mutex, PoisonError};

/// A constant, and the same in other types of numbers: each is made once, when a step first asks for it.
pub struct Casts<C> {
    original: C,
    others: Mutex<Vec<Box<dyn Any + Send>>>,
}

impl<C: Clone + Send + 'static> Casts<C> {
    /// Of a constant that shares its memory with its clones.
    pub fn new(original: C) -> Self {
        Self { original, others: Mutex::new(Vec::new()) }
    }

    /// The constant as it was made.
    pub fn original(&self) -> &C {
        &self.original
    }

    /// The constant of type `D`: the original where it has that type, else made by `cast` where nobody has asked for it.
    pub fn get<D: Clone + Send + 'static>(&self, cast: impl FnOnce(&C) -> D) -> D {
        if let Some(original) = (&self.original as &dyn Any).downcast_ref::<D>() {
            return original.clone();
        }
        let mut others = self.others.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = others.iter().find_map(|constant| constant.downcast_ref::<D>()) {
            return found.clone();
        }
        let made = cast(&self.original);
        others.push(Box::new(made.clone()));
        made
    }
}
