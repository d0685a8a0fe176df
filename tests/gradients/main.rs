//! Gradients: every operation of the catalogue keeps the laws of `bokashi-check`, and the check catches
//! every wrong adjoint made from it.

mod antialias;
mod exact;
mod partition;
mod picture;

use std::sync::Arc;

use bokashi_catalogue::Entry;
use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Check, Input, subject};
use proptest::prelude::*;

macro_rules! laws {
    ($($room:ident: $($name:ident)*;)*) => {
        /// The room and the name of each: operations of two rooms may have one name.
        const NAMES: &[[&str; 2]] = &[$($([stringify!($room), stringify!($name)]),*),*];

        $(mod $room {
            $(#[test]
            fn $name() {
                crate::keeps_the_laws([stringify!($room), stringify!($name)]);
            })*
        })*
    };
}

bokashi_catalogue::for_each_operation!(laws);

fn entry(name: [&str; 2]) -> Entry {
    let k = NAMES.iter().position(|&other| other == name).expect("it is in the catalogue");
    bokashi_catalogue::ENTRIES[k]()
}

/// The laws, and that they see every wrong adjoint.
fn keeps_the_laws(name: [&str; 2]) {
    for check in entry(name).checks() {
        check.assert();
        let kills = check.kills().unwrap_or_else(|failure| panic!("{failure}"));
        println!("{kills}");
        assert!(kills.tried > 0 && kills.survivors.is_empty(), "{kills}");
    }
}

#[test]
fn an_entry_has_the_name_under_which_it_is_listed() {
    for &name in NAMES {
        let entry = entry(name);
        assert_eq!(entry.name(), name[1]);
        assert!(!entry.checks().is_empty(), "{name:?} has no check");
    }
    assert_eq!(NAMES.len(), bokashi_catalogue::ENTRIES.len());
}

/// Operations without a gradient worth a control: it is zero, or has no entry.
#[test]
fn gradients_that_vanish() {
    subject!(Constant: |x| x[0].powi(0));
    subject!(NoRows: |x| x[0].gather_rows(&Arc::from([]))?);
    subject!(NoColumns: |x| x[0].slice(1, 2..2)?);
    subject!(Unit: |x| x[0].powf(T::ZERO));
    Check::new("powf of zero", Unit, leaves(&[3, 2])).assert();
    Check::new("powi of zero", Constant, leaves(&[3, 2])).assert();
    Check::new("gather of no rows", NoRows, leaves(&[4, 2])).assert();
    Check::new("slice of no columns", NoColumns, leaves(&[2, 4])).assert();
}

/// One leaf of one shape.
fn leaves(axes: &[usize]) -> BoxedStrategy<Vec<Input>> {
    tensor(axes, number()).prop_map(|x| vec![Input::leaf(x)]).boxed()
}
