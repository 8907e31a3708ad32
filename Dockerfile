# contid in a container: `docker build -t contid .`, then `docker run --rm --init contid run hand --virtual < circle.csv`.
# docs/service.md has the options for devices and real time. `.ci/container` runs the same steps without an engine.
FROM debian:bookworm-slim AS build
RUN apt-get update -q && apt-get install -qy --no-install-recommends ca-certificates g++ python3-dev python3-venv
COPY . /src
RUN python3 -m venv /build && /build/bin/pip wheel -q --no-deps -w /wheels /src

FROM debian:bookworm-slim
RUN apt-get update -q && apt-get install -qy --no-install-recommends ca-certificates python3 python3-venv && rm -rf /var/lib/apt/lists/*
COPY --from=build /wheels /wheels
RUN python3 -m venv /opt/contid && /opt/contid/bin/pip install -q --no-cache-dir "$(ls /wheels/contid-*.whl)[panel]" && rm -rf /wheels
# Serial adapters belong to the group dialout.
RUN useradd --create-home --groups dialout contid
USER contid
WORKDIR /home/contid
# Orderly, as Ctrl-C: `stop.on_interrupt` of the robot file.
STOPSIGNAL SIGINT
ENTRYPOINT ["/opt/contid/bin/contid"]
CMD ["run", "hand", "--mock"]
