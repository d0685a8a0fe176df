//! Constants in the type of numbers that a step has.

use std::any::Any;
use std::sync::{Mutex, PoisonError};

/// A constant of double precision in other types of numbers: each is made once, when a step first asks for it.
#[derive(Default)]
pub struct Casts(Mutex<Vec<Box<dyn Any + Send>>>);

impl Casts {
    /// The constant of type `C`, made by `cast` where nobody has asked for it yet.
    pub fn get<C: Clone + Send + 'static>(&self, cast: impl FnOnce() -> C) -> C {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = known.iter().find_map(|constant| constant.downcast_ref::<C>()) {
            return found.clone();
        }
        let made = cast();
        known.push(Box::new(made.clone()));
        made
    }
}
