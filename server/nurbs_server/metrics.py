"""What the server counts, in one registry per application."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from starlette.types import ASGIApp, Message, Receive, Scope, Send

BUILD_BUCKETS_S = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)


class Metrics:
    """Counters that the routes and the builds raise; ``/metrics`` shows them."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.requests = self._counter("requests", "answers by route and status", "route", "status")
        self.bytes_sent = self._counter("sent_bytes", "body bytes by route", "route")
        self.tile_cache = self._counter("tile_cache_lookups", "tiles found ready in memory or not", "result")
        self.builds = self._counter("builds", "on-demand builds by what was built and how it ended", "what", "result")
        self.build_seconds = Histogram(
            "nurbs_server_build_seconds",
            "time of an on-demand build",
            ["what"],
            registry=self.registry,
            buckets=BUILD_BUCKETS_S,
        )
        self._answers: dict[tuple[str, int], tuple[Counter, Counter]] = {}  # finding them again is what costs
        self.hit = self.tile_cache.labels("hit")
        self.miss = self.tile_cache.labels("miss")

    def _counter(self, name: str, text: str, *labels: str) -> Counter:
        return Counter(f"nurbs_server_{name}", text, labels, registry=self.registry)

    def count(self, route: str, status: int, n_bytes: int) -> None:
        """Count an answer and the bytes of its body."""
        children = self._answers.get((route, status))
        if children is None:
            children = self.requests.labels(route, str(status)), self.bytes_sent.labels(route)
            self._answers[route, status] = children
        children[0].inc()
        children[1].inc(n_bytes)

    def gauge(self, name: str, text: str) -> Gauge:
        """A further gauge in this registry."""
        return Gauge(f"nurbs_server_{name}", text, registry=self.registry)


class CountRequests:
    """ASGI middleware that counts answers and body bytes by the template of the route that matched."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app = app
        self.metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, listening to what is sent."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        status, sent = 500, 0

        async def listen(message: Message) -> None:
            nonlocal status, sent
            if message["type"] == "http.response.start":
                status = message["status"]
            else:
                sent += len(message.get("body", b""))
            await send(message)

        try:
            await self.app(scope, receive, listen)
        finally:
            self.metrics.count(getattr(scope.get("route"), "path", "unmatched"), status, sent)
