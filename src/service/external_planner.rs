//! Asks a program outside for waypoints: a question as JSON on its stdin, an answer on its stdout.
//!
//! The program is nobody's friend: it may fail, stay silent, hang or talk without end. It runs beside the
//! brain, within a time limit and in a process group of its own, which is killed with everything it
//! started when the time is over, when it says too much, or when the service ends. What it answers is
//! read strictly ([`mod@answer`]) and judged before it is flown
//! ([`crate::planning::external::admitted`]). Each failure comes back as a sentence for people.
#![doc = include_str!("external_planner/schema.md")]

pub mod answer;
mod child;
pub mod question;

use crate::pilot::{Job, JobOutput};
use crate::planning::external::{Proposal, admitted};
use crate::planning::planner::{Plan, PlanRequest};
use std::sync::Arc;
use tokio::runtime;
use tokio::task::spawn_blocking;
use tokio::time::timeout;

/// Does a job, whoever it takes. Dropping the future ends a program that is being asked.
pub async fn run(job: Arc<Job>) -> JobOutput {
    let Some(request) = job.outside() else {
        return spawn_blocking(move || job.run()).await.unwrap_or(JobOutput::Died);
    };
    let request = Arc::new(request.clone());
    match ask(&request).await {
        Ok(proposal) => {
            spawn_blocking(move || judged(&request, &proposal)).await.unwrap_or(JobOutput::Died)
        }
        Err(reason) => JobOutput::PlannedOutside(Err(reason)),
    }
}

/// The same for callers without a runtime: waits for the output.
#[must_use]
pub fn run_and_wait(job: Job) -> JobOutput {
    if job.outside().is_none() {
        return job.run();
    }
    match runtime::Builder::new_current_thread().enable_all().build() {
        Ok(runtime) => runtime.block_on(run(Arc::new(job))),
        Err(error) => JobOutput::PlannedOutside(Err(format!("no runtime: {error}"))),
    }
}

fn judged(request: &PlanRequest, proposal: &Proposal) -> JobOutput {
    let plan: Result<Plan, String> =
        admitted(request, proposal).map_err(|refusal| refusal.to_string());
    JobOutput::PlannedOutside(plan)
}

async fn ask(request: &Arc<PlanRequest>) -> Result<Proposal, String> {
    let Some(external) = request.settings.external.clone() else {
        return Err("no command is configured".to_owned());
    };
    let asked = Arc::clone(request);
    // Thousands of numbers become text beside the brain's thread.
    let question = spawn_blocking(move || question::encoded(&asked))
        .await
        .map_err(|error| error.to_string())?
        .map_err(|error| format!("the question cannot be written: {error}"))?;
    let limit = external.time_limit;
    let text = timeout(limit, child::converse(&external.command, question))
        .await
        .map_err(|_| format!("no answer within {:.1} s", limit.as_secs_f64()))??;
    answer::decoded(&text)
}
