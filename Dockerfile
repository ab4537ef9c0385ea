# The program alone, without a compiler and without root:
#
#   docker build -t autonomy .
#   docker run --rm -it autonomy fly --goal 4,3 --sim
#   docker run --rm -it --network host -v "$PWD/flights:/flights" autonomy fly --goal 4,3 --connection udpin://0.0.0.0:14540

FROM python:3.11-slim AS build
WORKDIR /source
COPY . .
RUN python -m venv /opt/autonomy \
 && /opt/autonomy/bin/pip install --no-cache-dir --prefer-binary ".[service,plots]"

FROM python:3.11-slim
RUN useradd --create-home --uid 1000 pilot \
 && install --directory --owner=pilot /flights /kernels
COPY --from=build /opt/autonomy /opt/autonomy
ENV PATH=/opt/autonomy/bin:$PATH \
    NUMBA_CACHE_DIR=/kernels \
    PYTHONUNBUFFERED=1
USER pilot
WORKDIR /
# Compile the kernels once, here and not before the first flight.
RUN python -c "from autonomy.warm import warm_up; warm_up()"
# Relative to the working directory, flight logs go to /flights.
VOLUME /flights
ENTRYPOINT ["autonomy"]
CMD ["--help"]
