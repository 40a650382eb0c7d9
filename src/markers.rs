//! Setting up markers: sheets to print, where to hang them, and a survey of where they hang.

mod constraints;
mod edges_file;
mod paper;
mod plan;
mod sheet;
mod survey;

pub use constraints::{
    ConstraintError, Constraints, EdgesSection, KnownSection, TagName, TapeSection,
};
pub use edges_file::note_edges;
pub use paper::{Paper, SheetError};
pub use plan::{PlanRequest, PlannedMarker, PlannedMarkers, draw, plan};
pub use sheet::{PrintJob, RULER_MM, TrueEdge, true_edge};
pub use survey::{
    HeldOut, SurveyError, SurveyReport, SurveyRequest, SurveyedTag, TapeLine, survey,
};
