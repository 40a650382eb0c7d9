//! What everybody may look at.

use crate::messages::VolumeAccount;
use crate::web::maps::{Map, MapKind};
use crate::web::scene::Scene;
use crate::web::series::Series;
use crate::web::shared::Shared;
use crate::web::{assets, metrics, openapi, socket};
use axum::Json;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Path, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::{StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use std::sync::Arc;
use utoipa::{OpenApi, ToSchema};

/// A state is short; nothing longer is taken from a viewer, bytes.
const LONGEST_WORD: usize = 1_024;
const JSON: [(axum::http::HeaderName, &str); 2] =
    [(CONTENT_TYPE, "application/json"), (CACHE_CONTROL, "no-store")];

#[derive(OpenApi)]
#[openapi(paths(state, scene, series, accounts, map, live, openapi, metrics))]
pub(in crate::web) struct LookDoc;

/// The picture of this moment.
#[utoipa::path(get, path = "/api/state", responses((status = 200, body = crate::web::state::State)))]
pub(super) async fn state(State(shared): State<Arc<Shared>>) -> Response {
    (JSON, Json(shared.picture())).into_response()
}

/// The hall as it is configured.
#[utoipa::path(get, path = "/api/scene", responses((status = 200, body = Scene)))]
pub(super) async fn scene(State(shared): State<Arc<Shared>>) -> Response {
    (JSON, Json(&shared.collector().scene)).into_response()
}

/// The volume over time and the path of this flight.
#[utoipa::path(get, path = "/api/series", responses((status = 200, body = Series)))]
pub(super) async fn series(State(shared): State<Arc<Shared>>) -> Response {
    (JSON, Json(&shared.collector().series)).into_response()
}

/// The account of one volume.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(in crate::web) struct Account {
    /// What is measured.
    name: String,
    /// Volume, m³.
    volume_m3: f64,
    /// Its standard deviation, m³.
    sigma_m3: f64,
    /// Mass, t, where the density is known.
    mass_t: Option<f64>,
    /// Its standard deviation, t.
    sigma_t: Option<f64>,
    /// What each source adds to the variance, m⁶, the largest first.
    budget: Vec<Row>,
}

/// A line of an account.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(in crate::web) struct Row {
    /// The source.
    source: &'static str,
    /// Its share of the variance, m⁶; of the density V² (`σ_ρ`/ρ)².
    var_m6: f64,
}

impl From<&VolumeAccount> for Account {
    fn from(account: &VolumeAccount) -> Self {
        let rows = account.budget.largest_first().into_iter();
        Self {
            name: account.name.clone(),
            volume_m3: account.estimate.volume_m3,
            sigma_m3: account.estimate.sigma_m3,
            mass_t: account.mass.map(|mass| mass.mass_t),
            sigma_t: account.mass.map(|mass| mass.sigma_t),
            budget: rows.map(|row| Row { source: row.source.name(), var_m6: row.var_m6 }).collect(),
        }
    }
}

/// The newest volumes with all digits: the whole region, then its bays.
#[utoipa::path(get, path = "/api/accounts", responses((status = 200, body = Vec<Account>)))]
pub(super) async fn accounts(State(shared): State<Arc<Shared>>) -> Response {
    let accounts: Vec<Account> = shared.collector().accounts().iter().map(Account::from).collect();
    (JSON, Json(accounts)).into_response()
}

/// A map; 404 while there is none.
#[utoipa::path(get, path = "/api/maps/{kind}", params(("kind" = MapKind, Path)),
    responses((status = 200, body = Map), (status = 404, description = "not measured yet")))]
pub(super) async fn map(State(shared): State<Arc<Shared>>, Path(kind): Path<MapKind>) -> Response {
    let mut collector = shared.collector();
    let collector = &mut *collector;
    match collector.maps.encoded(kind, &collector.scene) {
        Some(text) => (JSON, text.to_string()).into_response(),
        None => (StatusCode::NOT_FOUND, "not measured yet").into_response(),
    }
}

/// The picture by WebSocket, five times a second, as `/api/state` has it.
#[utoipa::path(get, path = "/api/live", responses((status = 101, description = "switching protocols")))]
pub(super) async fn live(State(shared): State<Arc<Shared>>, upgrade: WebSocketUpgrade) -> Response {
    upgrade.max_message_size(LONGEST_WORD).on_upgrade(move |socket| socket::serve(socket, shared))
}

/// This description.
#[utoipa::path(get, path = "/api/openapi.json", responses((status = 200, body = Object)))]
pub(super) async fn openapi() -> Response {
    (JSON, openapi::openapi_json()).into_response()
}

/// Numbers for Prometheus, OpenMetrics text.
#[utoipa::path(get, path = "/metrics", responses((status = 200, body = String)))]
pub(super) async fn metrics(State(shared): State<Arc<Shared>>) -> Response {
    match metrics::text(&shared) {
        Ok(text) => ([(CONTENT_TYPE, metrics::CONTENT_TYPE)], text).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}

/// The page's own files.
pub(super) async fn asset(uri: Uri) -> Response {
    assets::file(uri.path())
}
