//! What only who has the token may ask for.

use crate::messages::{Declaration, OperatorVerb};
use crate::web::access::TOKEN_HEADER;
use crate::web::review::Decision;
use crate::web::shared::{Shared, count};
use crate::web::verdict::Verdict;
use crate::web::wish::Wish;
use axum::Json;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;
use utoipa::openapi::security::{ApiKey, ApiKeyValue, SecurityScheme};
use utoipa::{Modify, OpenApi, ToSchema};

/// The brain answers within a tick; one that does not is in trouble.
const ANSWER_WITHIN: Duration = Duration::from_secs(2);
/// Who starts motors must have seen one of the last states: 3 s of them.
const OLDEST_SEEN: u64 = 15;
/// A remark is a sentence, characters.
const LONGEST_REMARK: usize = 500;
/// A name, characters.
const LONGEST_NAME: usize = 80;

#[derive(OpenApi)]
#[openapi(paths(token, wish, review), modifiers(&TokenScheme))]
pub(in crate::web) struct AskDoc;

struct TokenScheme;

impl Modify for TokenScheme {
    fn modify(&self, document: &mut utoipa::openapi::OpenApi) {
        let scheme = SecurityScheme::ApiKey(ApiKey::Header(ApiKeyValue::new(TOKEN_HEADER)));
        document.components.get_or_insert_default().add_security_scheme("token", scheme);
    }
}

/// A wish of a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(in crate::web) enum Verb {
    /// Begin a survey from the ground.
    Start,
    /// Begin another flight of the same survey from the ground, into its gaps.
    FlyGaps,
    /// Stop and keep the place.
    Hold,
    /// Go on after a hold.
    Resume,
    /// Fly back to the pad and land.
    Return,
    /// Land here.
    Land,
}

impl Verb {
    /// Motors begin to turn or the vehicle moves on: only with a fresh picture.
    const fn needs_fresh_eyes(self) -> bool {
        matches!(self, Self::Start | Self::FlyGaps | Self::Resume)
    }

    /// Motors begin to turn: somebody with a name must have said that they may.
    const fn needs_declaration(self) -> bool {
        matches!(self, Self::Start | Self::FlyGaps)
    }
}

impl From<Verb> for OperatorVerb {
    fn from(verb: Verb) -> Self {
        match verb {
            Verb::Start => Self::Start,
            Verb::FlyGaps => Self::FlyGaps,
            Verb::Hold => Self::Hold,
            Verb::Resume => Self::Resume,
            Verb::Return => Self::Return,
            Verb::Land => Self::Land,
        }
    }
}

/// What comes with a wish.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::web) struct Seen {
    /// `seq` of the newest state that the person saw; needed to start, to fly the gaps and to resume.
    seq: Option<u64>,
    /// What the person says before the motors turn; needed to start and to fly the gaps.
    declared: Option<Declared>,
}

/// What a named person says before the motors turn. It is kept in the log.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[expect(clippy::struct_excessive_bools, reason = "four things that are said one by one")]
pub(in crate::web) struct Declared {
    /// Who says so.
    by: String,
    /// Nobody is in the hall, and nobody can walk in.
    nobody_inside: bool,
    /// The remote control is in my hand, its mode and kill switches are tried.
    remote_in_hand: bool,
    /// Machines stand, doors and fans are as in the last survey.
    hall_as_before: bool,
    /// This hall is no dust zone, or a named person has released it.
    no_dust_zone: bool,
}

impl Declared {
    /// The declaration for a start, or what is missing in it.
    fn complete(&self, verb: Verb) -> Result<Declaration, &'static str> {
        let said =
            [self.nobody_inside, self.remote_in_hand, self.hall_as_before, self.no_dust_zone];
        let by = as_one_line(&self.by);
        if said.contains(&false) {
            Err("say all four things first")
        } else if by.is_empty() || by.chars().count() > LONGEST_NAME {
            Err("say who you are, in 80 characters at most")
        } else {
            Ok(Declaration { verb: verb.into(), by })
        }
    }
}

/// A text without ends of lines, spaces more than one at a time, and what moves a terminal or turns the
/// order of letters.
fn as_one_line(text: &str) -> String {
    let turns = |letter: char| matches!(letter, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    words.chars().filter(|letter| !letter.is_control() && !turns(*letter)).collect()
}

/// What became of a wish.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(in crate::web) struct Answer {
    /// It is done or under way.
    is_accepted: bool,
    /// The mission's phase after it; left out where the mission was not asked.
    phase: Option<&'static str>,
    /// Why it was refused, for a person.
    reason: Option<String>,
}

/// What people decide of the last flight.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::web) struct ReviewWish {
    /// The decision.
    verdict: Verdict,
    /// What the person says to it.
    #[serde(default)]
    remark: String,
    /// Who decides, for the report.
    #[serde(default)]
    by: Option<String>,
}

impl ReviewWish {
    /// Who decides; whoever leaves the line empty has given no name.
    fn decider(&self) -> Option<String> {
        let name: String = as_one_line(self.by.as_deref()?).chars().take(LONGEST_NAME).collect();
        (!name.is_empty()).then_some(name)
    }
}

fn refused(status: StatusCode, reason: impl Into<String>) -> Response {
    let answer = Answer { is_accepted: false, phase: None, reason: Some(reason.into()) };
    (status, Json(answer)).into_response()
}

fn judge(shared: &Shared, headers: &HeaderMap) -> Result<(), Box<Response>> {
    shared.access.may_ask(headers).map_err(|refusal| {
        count(&shared.counters.refused);
        Box::new(refused(refusal.status(), refusal.to_string()))
    })
}

/// Tells whether the token is right, and changes nothing.
#[utoipa::path(post, path = "/api/token", security(("token" = [])),
    responses((status = 204, description = "right"), (status = 401, body = Answer),
        (status = 403, body = Answer)))]
pub(super) async fn token(State(shared): State<Arc<Shared>>, headers: HeaderMap) -> Response {
    match judge(&shared, &headers) {
        Ok(()) => StatusCode::NO_CONTENT.into_response(),
        Err(refusal) => *refusal,
    }
}

/// What is said to a wish, or what is missing.
fn declaration(verb: Verb, said: Option<&Declared>) -> Result<Option<Declaration>, &'static str> {
    if !verb.needs_declaration() {
        return Ok(None);
    }
    said.ok_or("a start needs `declared`: say the four things first")?.complete(verb).map(Some)
}

/// Asks the mission for something; the answer is the mission's own.
#[utoipa::path(post, path = "/api/wishes/{verb}", params(("verb" = Verb, Path)),
    request_body = Seen, security(("token" = [])),
    responses((status = 200, body = Answer), (status = 401, body = Answer),
        (status = 403, body = Answer),
        (status = 409, body = Answer, description = "it makes no sense now, or the picture was old"),
        (status = 422, body = Answer, description = "a start without the whole declaration"),
        (status = 503, body = Answer), (status = 504, body = Answer)))]
pub(super) async fn wish(
    State(shared): State<Arc<Shared>>,
    Path(verb): Path<Verb>,
    headers: HeaderMap,
    Json(seen): Json<Seen>,
) -> Response {
    if let Err(refusal) = judge(&shared, &headers) {
        return *refusal;
    }
    let now_seq = shared.collector().seq;
    let is_fresh = seen.seq.is_some_and(|seq| seq <= now_seq && now_seq - seq <= OLDEST_SEEN);
    if verb.needs_fresh_eyes() && !is_fresh {
        count(&shared.counters.refused);
        return refused(StatusCode::CONFLICT, "the page was out of date: look again, then press");
    }
    let said = match declaration(verb, seen.declared.as_ref()) {
        Ok(said) => said,
        Err(missing) => {
            count(&shared.counters.refused);
            return refused(StatusCode::UNPROCESSABLE_ENTITY, missing);
        }
    };
    let (wish, answer) = Wish::new(verb.into(), said);
    if shared.wishes.try_send(wish).is_err() {
        return refused(StatusCode::SERVICE_UNAVAILABLE, "the brain takes nothing");
    }
    count(&shared.counters.wishes);
    let Ok(Ok(answer)) = timeout(ANSWER_WITHIN, answer).await else {
        return refused(StatusCode::GATEWAY_TIMEOUT, "the brain does not answer");
    };
    let phase = answer.phase.name();
    let reason = (!answer.is_accepted).then(|| format!("not possible in the phase {phase}"));
    let status = if answer.is_accepted { StatusCode::OK } else { StatusCode::CONFLICT };
    let answer = Answer { is_accepted: answer.is_accepted, phase: Some(phase), reason };
    (status, Json(answer)).into_response()
}

/// Accepts or rejects the flight that has ended; kept beside the log.
#[utoipa::path(post, path = "/api/review", request_body = ReviewWish, security(("token" = [])),
    responses((status = 200, body = Answer), (status = 401, body = Answer),
        (status = 403, body = Answer), (status = 409, body = Answer, description = "no flight"),
        (status = 507, body = Answer, description = "the disk refuses")))]
pub(super) async fn review(
    State(shared): State<Arc<Shared>>,
    headers: HeaderMap,
    Json(wish): Json<ReviewWish>,
) -> Response {
    if let Err(refusal) = judge(&shared, &headers) {
        return *refusal;
    }
    let picture = shared.picture();
    let Some(ended_at) = shared.collector().ended().map(|ended| ended.at) else {
        return refused(StatusCode::CONFLICT, "no flight has ended");
    };
    let decision = Decision {
        flight_ended_at_ns: ended_at.nanos(),
        verdict: wish.verdict,
        remark: as_one_line(&wish.remark).chars().take(LONGEST_REMARK).collect(),
        remarks: picture.review.remarks,
        decided_by: wish.decider(),
        decided_utc: jiff::Timestamp::now().to_string(),
    };
    if let Err(error) = shared.review.append(&decision) {
        tracing::error!(%error, "the decision on the flight could not be kept");
        return refused(StatusCode::INSUFFICIENT_STORAGE, format!("not kept: {error}"));
    }
    tracing::info!(verdict = ?wish.verdict, "a person decided on the flight");
    shared.collector().decide(wish.verdict);
    Json(Answer { is_accepted: true, phase: None, reason: None }).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decision_has_the_name_that_was_typed_or_none() {
        let by = |json: &str| serde_json::from_str::<ReviewWish>(json).unwrap().decider();
        assert_eq!(by(r#"{"verdict":"rejected","by":"  Zoë\n Doe "}"#).as_deref(), Some("Zoë Doe"));
        assert_eq!(
            by(r#"{"verdict":"accepted","by":"\u001b[2JAn\u202ena"}"#).as_deref(),
            Some("[2JAnna")
        );
        assert_eq!(by(r#"{"verdict":"accepted","by":"  "}"#), None);
        assert_eq!(by(r#"{"verdict":"accepted"}"#), None);
        let long = format!(r#"{{"verdict":"accepted","by":"{}"}}"#, "é".repeat(81));
        assert_eq!(by(&long).unwrap(), "é".repeat(80));
    }
}
