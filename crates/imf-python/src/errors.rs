//! Which exception an error becomes: `OSError` where a file cannot be opened or written (`FileNotFoundError` where there is none),
//! `ValueError` where what was given makes no sense, `ImfError` where a computation failed.

use imf_core::access::RemovableError;
use imf_core::check::{CheckError, LineFault};
use imf_core::control::Cancelled;
use imf_core::field::{EngineError, FieldError};
use imf_core::file_error::{FaultKind, FileError};
use imf_core::orientation::OrientationSetError;
use imf_core::parts::UnknownPart;
use imf_core::scene::{SceneError, SceneWarning};
use imf_core::section::SectionError;
use imf_core::surface::{CandidatesError, SurfaceError};
use imf_core::tool::{ClearanceError, ToolError};
use imf_core::toolpath::ToolpathError;
use imf_core::unit::UnknownUnit;
use imf_core::world::QueryError;
use imf_fields::field::LoadError;
use imf_fields::field::calibrate::CalibrationError;
use imf_fields::file::FieldFileError;
use imf_fields::harmonic::HarmonicError;
use imf_fields::recipe::RecipeError;
use imf_fields::siren::ShapeError;
use imf_train::dataset::DatasetError;
use imf_train::training::run::TrainError;
use pyo3::PyErr;
use pyo3::exceptions::{PyFileNotFoundError, PyOSError, PyValueError};

pyo3::create_exception!(
    imf,
    ImfError,
    pyo3::exceptions::PyException,
    "A computation that failed for another reason than what it was given: a training that diverged, a device, memory."
);

/// An error as Python raises it.
pub(crate) trait Raise {
    /// The exception, with the error's words and those of what caused it.
    fn raise(self) -> PyErr;
}

/// What work reports that can fail in several ways.
pub(crate) struct Failure(pub(crate) PyErr);

impl<E: Raise> From<E> for Failure {
    fn from(error: E) -> Self {
        Self(error.raise())
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        failure.0
    }
}

/// The words of an error and of its causes.
fn words(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let more = error.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        cause = error.source();
    }
    text
}

pub(crate) fn value_error(text: impl Into<String>) -> PyErr {
    PyValueError::new_err(text.into())
}

/// With its words and those of its causes, and what the remedy is called here.
fn invalid(error: &(dyn std::error::Error + 'static)) -> PyErr {
    let mut causes = std::iter::successors(Some(error), |error| error.source());
    match causes.find_map(remedy) {
        Some(keywords) => value_error(format!("{} ({keywords})", words(error))),
        None => value_error(words(error)),
    }
}

/// The keywords that a library's remedy means here.
fn remedy(cause: &(dyn std::error::Error + 'static)) -> Option<&'static str> {
    match cause.downcast_ref() {
        Some(SceneError::FixtureOutside(_)) => return Some("around='all', or margin"),
        Some(SceneError::ThinFixture { .. } | SceneError::NoSolid { .. }) => {
            return Some("conservative=True");
        }
        Some(SceneError::Coarse(_)) => return Some("imf.Scene: allow_coarse=True"),
        Some(SceneError::NoTool(_)) => return Some("imf.Tool"),
        _ => {}
    }
    match cause.downcast_ref()? {
        CheckError::Tools(_)
        | CheckError::Line { fault: LineFault::ToolChange { .. } | LineFault::NoTool { .. }, .. } => {
            Some("tools={NUMBER: TOOL}")
        }
        CheckError::Line { fault: LineFault::NoRoll { .. }, .. } => Some("or poses with quaternions, (n, 7)"),
        _ => None,
    }
}

/// A warning, and what its remedy is called here.
pub(crate) fn warning(warning: &SceneWarning) -> String {
    let keywords = match warning {
        SceneWarning::Step { .. } | SceneWarning::Lost { .. } => " (conservative=True)",
        _ => "",
    };
    format!("{warning}{keywords}")
}

fn failed(error: &dyn std::error::Error) -> PyErr {
    ImfError::new_err(words(error))
}

/// What the system said to a file is its source; everything else is what the file holds.
fn of_file(error: &(dyn std::error::Error + 'static)) -> PyErr {
    match error.source().and_then(|source| source.downcast_ref::<std::io::Error>()) {
        Some(system) if system.kind() == std::io::ErrorKind::NotFound => {
            PyFileNotFoundError::new_err(words(error))
        }
        Some(_) => PyOSError::new_err(words(error)),
        None => invalid(error),
    }
}

/// By a function, apart from the error within a variant, which is raised by its own.
macro_rules! raise_as {
    ($raise:ident: $($error:ident $(except $inner:ident)?),+) => {
        $(impl Raise for $error {
            fn raise(self) -> PyErr {
                $(if let Self::$inner(error) = self {
                    return error.raise();
                })?
                $raise(&self)
            }
        })+
    };
}

raise_as!(invalid: CandidatesError, CheckError, ClearanceError, FieldError except Engine, HarmonicError, LoadError except File, QueryError,
    RecipeError, RemovableError, SceneError except File, SectionError, ShapeError, SurfaceError, ToolError,
    UnknownPart, UnknownUnit, CalibrationError);
// `Cancelled`: of work that stopped without a request.
raise_as!(failed: Cancelled, DatasetError, EngineError, TrainError except Plan);
raise_as!(of_file: FieldFileError, OrientationSetError, ToolpathError);

impl Raise for FileError {
    fn raise(self) -> PyErr {
        let text = words(&self);
        match self.fault.kind {
            FaultKind::Missing => PyFileNotFoundError::new_err(text),
            FaultKind::Unreadable => PyOSError::new_err(text),
            _ => PyValueError::new_err(text),
        }
    }
}
