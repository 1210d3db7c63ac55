"""The routes of experiments, under /api/v1."""

import asyncio
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Query, Request

from server.api.experiment_models import (
    ExperimentAnswer,
    ExperimentInfo,
    ExperimentPage,
    ExperimentRequest,
)
from server.api.identity import author_of
from server.api.laboratory import Experiment, Laboratory
from server.api.missions import MAX_PAGE, Responses, service_of
from server.api.models import ErrorAnswer

ExperimentPath = Annotated[
    str, Path(pattern=r"^e[0-9]{1,9}$", description="Of GET /experiments.", examples=["e1"])
]

_NOT_FOUND: Responses = {HTTPStatus.NOT_FOUND: {"model": ErrorAnswer}}

router = APIRouter(
    tags=["experiments"], responses={HTTPStatus.UNPROCESSABLE_ENTITY: {"model": ErrorAnswer}}
)


def laboratory_of(request: Request) -> Laboratory:
    """Return the application's laboratory."""
    laboratory: Laboratory = request.app.state.laboratory
    return laboratory


Lab = Annotated[Laboratory, Depends(laboratory_of)]
Author = Annotated[str, Depends(author_of)]


@router.post(
    "/experiments",
    status_code=HTTPStatus.CREATED,
    responses={HTTPStatus.CONFLICT: {"model": ErrorAnswer}},
)
async def begin_experiment(
    body: ExperimentRequest, request: Request, laboratory: Lab, author: Author
) -> ExperimentInfo:
    """Begin a campaign. One runs at a time; the others wait in order."""
    campaign = await asyncio.to_thread(body.campaign, service_of(request))
    made = laboratory.begin(campaign, author)
    return ExperimentInfo(**_told(made))


@router.get("/experiments")
async def list_experiments(
    laboratory: Lab,
    after: Annotated[int, Query(ge=0, le=2**53, description="Number of an experiment.")] = 0,
    limit: Annotated[int, Query(ge=1, le=MAX_PAGE)] = 100,
) -> ExperimentPage:
    """Return the experiments begun since the server started, oldest first."""
    found = [e for e in laboratory.all() if int(e.id[1:]) > after][:limit]
    return ExperimentPage(
        experiments=[ExperimentInfo(**_told(experiment)) for experiment in found],
        next_after=int(found[-1].id[1:]) if found else after,
    )


@router.get("/experiments/{experiment_id}", responses=_NOT_FOUND)
async def get_experiment(experiment_id: ExperimentPath, laboratory: Lab) -> ExperimentAnswer:
    """Return how far a campaign is and, once it is done, what it found."""
    found = laboratory.one(experiment_id)
    return ExperimentAnswer(**_told(found), result=found.result)


@router.post("/experiments/{experiment_id}/stop", responses=_NOT_FOUND)
async def stop_experiment(experiment_id: ExperimentPath, laboratory: Lab) -> ExperimentInfo:
    """End a campaign; one that is over stays as it is."""
    return ExperimentInfo(**_told(await laboratory.stop(experiment_id)))


def _told(experiment: Experiment) -> dict[str, Any]:
    return {
        "id": experiment.id,
        "kind": experiment.kind,
        "state": experiment.state,
        "author": experiment.author,
        "created_at": experiment.created_at,
        "runs": experiment.runs,
        "done": experiment.done,
        "error": experiment.error,
    }
