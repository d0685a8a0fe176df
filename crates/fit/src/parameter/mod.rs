//! Named parameters, which a fit changes.
//!
//! Each parameter has a learning rate of its own and, where its values are restricted, a mapping
//! from *raw* numbers that an optimizer may move freely: `value = mapping(raw)`. Vertices of a mesh may
//! have a preconditioner instead, a linear map. Gradients and rates are those of the raw numbers.

mod list;
mod mapping;
mod single;
mod variables;

pub use self::list::Parameters;
pub use self::mapping::Mapping;
pub use self::single::Parameter;
pub use self::variables::Variables;
