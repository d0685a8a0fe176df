//! Named parameters, which a fit changes.
//!
//! Each parameter has a learning rate. An optimizer moves its *raw* numbers freely, and where values are restricted,
//! `value = mapping(raw)`. Vertices of a mesh may have a preconditioner instead, a linear map. Gradients and rates
//! are those of the raw numbers.

mod list;
mod mapping;
mod single;
mod variables;

pub use self::list::Parameters;
pub use self::mapping::Mapping;
pub use self::single::Parameter;
pub use self::variables::Variables;
