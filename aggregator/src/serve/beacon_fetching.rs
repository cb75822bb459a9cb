//! Fetches the beacon that an open round waits for, and records it. A beacon that cannot be had is asked for again, until the rules
//! close the round without one. Nothing else waits for it.

use crate::round::awaited_beacon::AwaitedBeacon;
use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service};
use zk0_protocol::challenge::drawing::Drawing;

impl Service {
    /// Fetches the beacon and records it. If that is not possible now, returns the reason.
    pub(super) async fn fetch_beacon(
        &self,
        awaited: AwaitedBeacon,
    ) -> Result<Option<String>, RequestError> {
        let servers = self.beacons.clone();
        let AwaitedBeacon {
            round,
            chain,
            beacon,
        } = awaited;
        let fetched = blocking(move || Ok(servers.fetch(&chain, beacon))).await?;
        let signature = match fetched {
            Ok(signature) => signature,
            Err(error) => {
                return Ok(Some(format!(
                    "round {round} waits for its randomness: {error}"
                )))
            }
        };
        let drawing = Drawing::Drand {
            round: beacon,
            signature,
        };
        let drawn = self
            .with(move |aggregator| aggregator.draw(round, drawing))
            .await;
        match drawn {
            Ok(()) => Ok(None),
            // It came too late: the round closes without it.
            Err(RequestError::Violation(why)) => Ok(Some(why.to_string())),
            // The next step says more.
            Err(RequestError::Clock(_)) => Ok(Some("the clock is wrong".into())),
            Err(error) => Err(error),
        }
    }
}
