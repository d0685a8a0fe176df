//! What operations are run on where their time, their memory and their threads are examined.

use std::sync::Arc;

use bokashi_check::Case;

use crate::setting::Setting;

/// An operation, and what it is run on.
#[derive(Debug, Clone, Copy)]
pub struct Benchmark {
    pub(crate) label: &'static str,
    pub(crate) case: fn(&Arc<Setting>) -> Case,
}

impl Benchmark {
    /// The name that the operation has on the tape, and after a comma what it works on.
    pub fn label(&self) -> &'static str {
        self.label
    }

    /// The name that the operation has on the tape.
    pub fn name(&self) -> &'static str {
        self.label.split(',').next().unwrap_or(self.label)
    }

    /// The operation on inputs of the size of a setting, all of them leaves.
    pub fn case(&self, setting: &Arc<Setting>) -> Case {
        (self.case)(setting)
    }
}

/// Adds a benchmark to an entry: its label, its inputs in a setting, and what is recorded of them. Nothing but
/// the operation: subjects that say on which smooth piece their inputs lie would take time and memory of their
/// own.
macro_rules! benchmark {
    ($entry:ident, $label:literal, |$setting:ident| [$($input:expr),* $(,)?], |$x:ident| $output:expr) => {{
        #[derive(Debug)]
        struct Recorded(std::sync::Arc<$crate::setting::Setting>);

        impl bokashi_check::Subject for Recorded {
            fn apply<'t, T: bokashi_core::Scalar>(
                &self,
                _: &'t bokashi_core::Tape<T>,
                $x: &[bokashi_core::Var<'t, T>],
            ) -> bokashi_check::Applied<'t, T> {
                #[allow(unused_variables, reason = "some operations need their inputs alone")]
                let $setting = &*self.0;
                Ok($output.into())
            }
        }

        $entry.benchmark($crate::Benchmark {
            label: $label,
            case: |shared| {
                #[allow(unused_variables, reason = "some inputs are of one size")]
                let $setting = &**shared;
                let inputs = [$($input.clone()),*].map(bokashi_check::Input::leaf);
                bokashi_check::Case::new(Recorded(std::sync::Arc::clone(shared)), inputs)
            },
        });
    }};
}

pub(crate) use benchmark;
