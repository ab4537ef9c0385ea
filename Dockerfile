# The service and the program, without a compiler and without root, for linux/amd64 and linux/arm64:
#
#   docker build -t autonomy .
#   docker run --rm -it autonomy fly --goal 4,3 --sim                    # the demonstration: one flight
#   docker run --rm -it --network host autonomy serve --sim              # page: http://127.0.0.1:8042
#   docker buildx build --platform linux/amd64,linux/arm64 -t REGISTRY/autonomy --push .
#
# On a drone (the default command is `autonomy serve`):
#
#   docker run --detach --name autonomy --restart on-failure --stop-timeout 150 --network host \
#     --device /dev/ttyAMA0 --group-add dialout \
#     --volume /etc/autonomy:/etc/autonomy:ro --volume autonomy-flights:/flights \
#     autonomy serve --config /etc/autonomy/config.yaml --connection serial:///dev/ttyAMA0:921600
#
# Ports: 8042/tcp page and API (loopback, unless service.host says otherwise; then AUTONOMY_TOKEN or a
# token file is demanded), 14540/udp MAVLink from a simulation. Devices: the autopilot's serial port;
# for sensors of this computer's own /dev/i2c-1 and /dev/gpiochip0, a GNSS receiver's port.
# tools/container/README.md has the rest, and what of this was proved how.

# Both platforms' index. Another base: --build-arg BASE=...; it needs `python` and `python -m venv`.
ARG BASE=python:3.11.16-slim-bookworm@sha256:528257d48c1da0dcecc2e725d1ae34498d60c965f1241e39cd6a85a8859bdf84

# hadolint ignore=DL3006 # the argument's default is pinned by its digest
FROM ${BASE} AS build
WORKDIR /source
RUN python -m venv /opt/autonomy
COPY requirements.lock ./
RUN /opt/autonomy/bin/python -m pip install --no-cache-dir --only-binary :all: --require-hashes \
      --requirement requirements.lock
COPY pyproject.toml README.md LICENSE ./
COPY configs/scenarios configs/scenarios
COPY hal hal
COPY autonomy autonomy
# What only installing needs, the libraries' own tests, and MAVLink's other dialects stay behind.
RUN /opt/autonomy/bin/python -m pip install --no-cache-dir --no-index --no-deps \
      --no-build-isolation . \
 && /opt/autonomy/bin/python -m pip uninstall --yes setuptools pip \
 && find /opt/autonomy -type d -name tests -prune -exec rm -r {} + \
 && find /opt/autonomy -path '*/pymavlink/dialects/*' -type f \
      ! -name '__init__*' ! -name 'common*' ! -name 'development*' -delete

# hadolint ignore=DL3006 # as above
FROM ${BASE}
# Whoever the container runs as (--user) may keep kernels and flight logs.
RUN useradd --create-home --uid 1000 pilot \
 && install --directory --owner=pilot --mode=0777 /flights /kernels
COPY --from=build /opt/autonomy /opt/autonomy
# Kernels are compiled here, once, for any processor of the platform, not before the first flight for
# the one at hand. Python's own allocator keeps a megabyte more after each mission.
ENV PATH=/opt/autonomy/bin:$PATH \
    AUTONOMY_URL=http://127.0.0.1:8042 \
    NUMBA_CACHE_DIR=/kernels \
    NUMBA_CPU_NAME=generic \
    PYTHONMALLOC=malloc \
    PYTHONUNBUFFERED=1
USER 1000
RUN python -m autonomy.warm && chmod -R a+rwX /kernels
# Relative to it, flight logs go to /flights.
WORKDIR /
VOLUME /flights
EXPOSE 8042/tcp 14540/udp
# Asked without a token. Where the service listens elsewhere: --env AUTONOMY_URL=http://...
HEALTHCHECK --interval=30s --timeout=10s --start-period=2m --retries=3 CMD ["python", "-c", \
  "import os, urllib.request; urllib.request.urlopen(os.environ['AUTONOMY_URL'] + '/v1/health', timeout=5)"]
ENTRYPOINT ["autonomy"]
CMD ["serve"]
